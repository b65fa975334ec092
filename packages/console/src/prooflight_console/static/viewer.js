// Seen, expected and difference with one zoom: side by side, wiped, blinking, or the difference alone. Keys: S, W, B, D; + and - zoom, 0 shows the page.
"use strict";

const look = () => {
  const viewers = document.getElementById("viewers");
  if (!viewers) return;
  // OpenSeadragon adds a style element of its own unless there is one, which the content security policy forbids.
  const mark = document.createElementNS("urn:prooflight", "style");
  mark.setAttribute("data-openseadragon-mobile-css", "true");
  document.head.append(mark);
  // Three pictures next to each other are too narrow on a phone; viewers are made at the size that they have then.
  const narrow = viewers.querySelectorAll("figure").length === 3 && matchMedia("(max-width: 560px)").matches;
  if (narrow) viewers.dataset.mode = "wipe";
  const told = JSON.parse(document.getElementById("picture").textContent);
  const perMm = told.width / told.width_mm / told.width; // OpenSeadragon's unit is the picture's width
  const panes = [...viewers.querySelectorAll("figure")].map((figure) => {
    const layer = figure.dataset.layer;
    const viewer = OpenSeadragon({
      element: figure.querySelector(".pane"),
      drawer: "canvas",
      showNavigationControl: false,
      animationTime: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 0.35,
      maxZoomPixelRatio: 6,
      minZoomImageRatio: 0.8,
      visibilityRatio: 0.6,
      imageSmoothingEnabled: false,
      gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true },
      gestureSettingsTouch: { pinchRotate: false },
      tileSources: {
        width: told.width,
        height: told.height,
        tileSize: told.tile,
        minLevel: 0,
        maxLevel: told.levels - 1,
        getTileUrl: (level, column, row) => `${viewers.dataset.tiles}/${layer}/${level}/${column}/${row}`,
      },
    });
    return { figure, layer, viewer };
  });

  // --- one zoom ---

  let leading = false;
  const follow = (leader) => {
    if (leading) return;
    leading = true;
    for (const { viewer } of panes) {
      if (viewer === leader) continue;
      viewer.viewport.zoomTo(leader.viewport.getZoom(), null, false);
      viewer.viewport.panTo(leader.viewport.getCenter(), false);
    }
    leading = false;
  };
  const box = (region, margin) => {
    const wide = Math.max(region.width_mm, margin) + margin;
    const high = Math.max(region.height_mm, margin) + margin;
    const x = region.x_mm + region.width_mm / 2 - wide / 2;
    const y = region.y_mm + region.height_mm / 2 - high / 2;
    return new OpenSeadragon.Rect(x * perMm, y * perMm, wide * perMm, high * perMm);
  };
  // What was seen of a defect that is longer than the stored section is that section.
  const place = (at_once) => {
    const first = told.regions[0];
    const [x_mm, y_mm, width_mm, height_mm] = told.whole ? [] : (told.cuts[0]?.box_mm ?? []);
    const bounds = x_mm === undefined ? first && box(first, 8) : box({ x_mm, y_mm, width_mm, height_mm }, 1);
    if (bounds) panes[0].viewer.viewport.fitBounds(bounds, at_once);
  };
  let ready = 0;
  for (const { viewer, layer } of panes) {
    viewer.addHandler("zoom", () => follow(viewer));
    viewer.addHandler("pan", () => follow(viewer));
    viewer.addHandler("open", () => {
      const lay = (name, x_mm, y_mm, width_mm, height_mm) => {
        const frame = document.createElement("div");
        frame.className = name;
        const rect = new OpenSeadragon.Rect(x_mm * perMm, y_mm * perMm, width_mm * perMm, height_mm * perMm);
        viewer.addOverlay({ element: frame, location: rect, checkResize: false });
      };
      if (layer !== "expected" && !told.whole) for (const cut of told.cuts) lay("cut", ...cut.box_mm);
      told.regions.forEach((region, index) => {
        lay(index ? "region" : "region first", region.x_mm, region.y_mm, region.width_mm, region.height_mm);
      });
      ready += 1;
      if (ready === panes.length) {
        place(true);
        viewers.dataset.ready = "1";
      }
    });
  }

  // --- how they are shown ---

  let blinking = 0;
  const show = (mode) => {
    viewers.dataset.mode = mode;
    clearInterval(blinking);
    viewers.classList.remove("blinked");
    if (mode === "blink") blinking = setInterval(() => viewers.classList.toggle("blinked"), 600);
    for (const button of document.querySelectorAll("[data-mode][aria-pressed]")) {
      button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
    }
    for (const { viewer } of panes) viewer.forceResize?.();
    requestAnimationFrame(() => follow(panes[0].viewer));
  };
  const zoom = (how) => {
    const viewport = panes[0].viewer.viewport;
    if (how === "place") place(false);
    else if (how === "page") viewport.goHome();
    else viewport.zoomBy(how === "in" ? 1.5 : 1 / 1.5);
    viewport.applyConstraints();
  };
  for (const button of document.querySelectorAll("button[data-mode]")) button.addEventListener("click", () => show(button.dataset.mode));
  for (const button of document.querySelectorAll("button[data-zoom]")) button.addEventListener("click", () => zoom(button.dataset.zoom));
  if (narrow) show("wipe");
  const wipe = viewers.querySelector(".wipe");
  wipe.addEventListener("input", () => viewers.style.setProperty("--wipe", wipe.value + "%"));

  document.addEventListener("keydown", (event) => {
    if (event.target.matches("input, textarea, select") || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    const modes = { s: "side", w: "wipe", b: "blink", d: "difference" };
    if (modes[key] && panes.length === 3) show(modes[key]);
    else if (key === "+") zoom("in");
    else if (key === "-") zoom("out");
    else if (key === "0") zoom("page");
    else if (key === "1") zoom("place");
  });
};
look();

// --- pictures that come: the answer comes when all is made, and whoever writes a note meanwhile is not disturbed ---

const coming = document.getElementById("coming");
const arrived = async () => {
  const made = await fetch(coming.dataset.pictures);
  const whole = made.ok && (await fetch(location.href));
  const box = whole?.ok && new DOMParser().parseFromString(await whole.text(), "text/html").querySelector(".viewer-box");
  if (!box || box.querySelector("#coming")) throw new Error(coming.dataset.pictures);
  coming.closest(".viewer-box").replaceWith(box);
  look();
};
if (coming) arrived().catch(() => {
  document.getElementById("coming-note").hidden = true;
  document.getElementById("coming-not").hidden = false;
});

// --- one tap, one key; but never Enter, with which readers of bar codes end what they read ---

document.addEventListener("keydown", (event) => {
  if (event.key === "Enter" && event.target.closest(".tap, .vouch")) event.preventDefault();
});

document.addEventListener("keydown", (event) => {
  if (event.target.matches("input, textarea, select") || event.ctrlKey || event.metaKey || event.altKey) return;
  document.querySelector(`.tap[data-key="${CSS.escape(event.key.toUpperCase())}"]`)?.click();
});
