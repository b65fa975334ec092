// Zones on the pages of a job: drawn, moved and resized by mouse, touch and keyboard; proposals accepted or left.
// What is drawn stays in this window until it is saved; zones-price.js asks its price and saves it.
"use strict";

const told = JSON.parse(one("told").textContent);
const words = told.words;
const KINDS = ["ignore", "normal", "careful"];
const LEAST_MM = 1;
const STEP_MM = 1;
const FINE_MM = 0.1;
const NAME_PX = 13;
const NAME_LETTERS = 32;
const HANDLE_PX = 8;
const REACH_PX = 22; // a finger's
const DRAFT = `zones:${told.job}`;

const desk = one("desk");
const svg = one("zones");
const list = one("list");
const form = one("chosen");
const SVG = "http://www.w3.org/2000/svg";

const put = (text, values) => text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
const fixed = (value) => Number(value.toFixed(2));
const shown = (value, digits = 1) => value.toLocaleString(document.documentElement.lang, { maximumFractionDigits: digits });
const made = (tag, attributes, ...inside) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null) element.setAttribute(name, value);
  }
  element.append(...inside);
  return element;
};
const drawn = (tag, attributes) => {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
};

// --- what is drawn ---

const Draft = {
  zones: [],
  before: [],
  begin() {
    this.zones = structuredClone(told.saved.zones);
    const kept = JSON.parse(sessionStorage.getItem(DRAFT) ?? "null");
    if (kept?.tag === told.tag) this.zones = kept.zones;
  },
  text() {
    return JSON.stringify(this.zones);
  },
  // Called before a change: that it can be undone.
  keep() {
    this.before.push(this.text());
    if (this.before.length > 200) this.before.shift();
  },
  changed() {
    sessionStorage.setItem(DRAFT, JSON.stringify({ tag: told.tag, zones: this.zones }));
    show();
    document.dispatchEvent(new Event("prooflight:zones"));
  },
  undo() {
    const last = this.before.pop();
    if (last === undefined) return;
    this.zones = JSON.parse(last);
    chosen = null;
    this.changed();
  },
};

let page = 1;
let chosen = null;
let proposed = [];
const left = new Set(); // proposals that somebody does not want
let tool = "look";

const size = () => ({ width: told.sizes_mm[page - 1][0], height: told.sizes_mm[page - 1][1] });
const on_page = (zone, number) => {
  if (zone.pages === "all") return true;
  return zone.pages.split(",").some((part) => {
    const [first, last] = part.split("-").map(Number);
    return number >= first && number <= (last || first);
  });
};
const corners = (zone) => {
  if (zone.polygon_mm) return zone.polygon_mm;
  const [x, y, width, height] = zone.rectangle_mm;
  return [[x, y], [x + width, y], [x + width, y + height], [x, y + height]];
};
const box = (zone) => {
  if (zone.rectangle_mm) return zone.rectangle_mm;
  const x = zone.polygon_mm.map((corner) => corner[0]);
  const y = zone.polygon_mm.map((corner) => corner[1]);
  return [Math.min(...x), Math.min(...y), Math.max(...x) - Math.min(...x), Math.max(...y) - Math.min(...y)];
};
// A box on the page, at least a millimetre wide and high.
const fitting = ([x, y, width, height], moving = false) => {
  const { width: most_x, height: most_y } = size();
  if (moving) return [clamp(x, 0, Math.max(most_x - width, 0)), clamp(y, 0, Math.max(most_y - height, 0)), width, height].map(fixed);
  const begin = [clamp(x, 0, most_x - LEAST_MM), clamp(y, 0, most_y - LEAST_MM)];
  return [...begin, clamp(width, LEAST_MM, most_x - begin[0]), clamp(height, LEAST_MM, most_y - begin[1])].map(fixed);
};
const clamp = (value, least, most) => Math.min(Math.max(value, least), most);
const set_box = (zone, to) => {
  if (zone.polygon_mm) {
    const from = box(zone);
    const scale = (value, axis) => to[axis] + ((value - from[axis]) * to[axis + 2]) / (from[axis + 2] || 1);
    zone.polygon_mm = zone.polygon_mm.map(([x, y]) => [fixed(scale(x, 0)), fixed(scale(y, 1))]);
  } else zone.rectangle_mm = to;
};
const place = (zone) => {
  const [x, y, width, height] = box(zone);
  return put(words.at, { x: shown(x), y: shown(y), width: shown(width), height: shown(height) });
};
const fresh_name = (kind) => {
  const taken = new Set(Draft.zones.map((zone) => zone.name));
  for (let number = 1; ; number += 1) {
    const name = `${words["name." + kind]} ${number}`;
    if (!taken.has(name)) return name;
  }
};
const add = (zone) => {
  Draft.keep();
  Draft.zones.push(zone);
  chosen = zone;
  Draft.changed();
};
const new_zone = (kind, rectangle_mm) => ({
  name: fresh_name(kind),
  kind,
  pages: told.sizes_mm.length === 1 ? "all" : String(page),
  rectangle_mm,
  polygon_mm: null,
});
const remove = (zone) => {
  Draft.keep();
  const at = here().indexOf(zone);
  Draft.zones.splice(Draft.zones.indexOf(zone), 1);
  chosen = null;
  Draft.changed();
  (list.querySelectorAll("button")[Math.max(at - 1, 0)] ?? one("add")).focus();
};
const here = () => Draft.zones.filter((zone) => on_page(zone, page));
const same_place = (one_zone, other) => JSON.stringify(box(one_zone)) === JSON.stringify(box(other)) && one_zone.name === other.name;
const key_of = (proposal) => JSON.stringify([page, proposal.zone.name, box(proposal.zone)]);
const open_proposals = () => proposed.filter((each) => !left.has(key_of(each)) && !here().some((zone) => same_place(zone, each.zone)));

// --- the page ---

// OpenSeadragon adds a style element of its own unless there is one, which the content security policy forbids.
const mark = document.createElementNS("urn:prooflight", "style");
mark.setAttribute("data-openseadragon-mobile-css", "true");
document.head.append(mark);
const viewer = OpenSeadragon({
  element: one("pane"),
  drawer: "canvas",
  showNavigationControl: false,
  animationTime: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 0.3,
  maxZoomPixelRatio: 8,
  minZoomImageRatio: 0.8,
  visibilityRatio: 0.6,
  gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true },
  gestureSettingsTouch: { pinchRotate: false },
});
viewer.innerTracker.keyHandler = null; // arrows move zones
viewer.innerTracker.keyDownHandler = null;

const per_px = () => {
  const bounds = viewer.viewport.getBounds(true);
  return (bounds.width * size().width) / Math.max(desk.clientWidth, 1);
};
const follow = () => {
  if (!viewer.world.getItemCount()) return;
  const bounds = viewer.viewport.getBounds(true);
  const wide = size().width; // OpenSeadragon's unit is the picture's width
  svg.setAttribute("viewBox", `${bounds.x * wide} ${bounds.y * wide} ${bounds.width * wide} ${bounds.height * wide}`);
  draw();
};
const turn = async (to) => {
  page = clamp(to, 1, told.sizes_mm.length);
  chosen = null;
  proposed = [];
  delete desk.dataset.ready;
  one("page-name").textContent = `${words.page} ${page}`;
  if (one("page")) one("page").value = String(page);
  note(words.coming);
  show();
  const base = `/api/v1/jobs/${told.job}/pages/${page}`;
  const asked = page;
  looked_for(base, asked);
  const picture = await asked_of(`${base}/picture`);
  if (asked !== page) return;
  if (picture.problem) { note(picture.problem); return; }
  viewer.open({
    width: picture.width,
    height: picture.height,
    tileSize: picture.tile,
    minLevel: 0,
    maxLevel: picture.levels - 1,
    getTileUrl: (level, column, row) => `${base}/picture/${level}/${column}/${row}`,
  });
};
const looked_for = async (base, asked) => {
  delete one("proposals").dataset.ready;
  one("no-proposal").hidden = false;
  one("no-proposal").textContent = words.looking;
  const found = await asked_of(`${base}/proposals`);
  if (asked !== page) return;
  proposed = found.items ?? [];
  one("no-proposal").textContent = found.problem ?? words.nothing;
  one("proposals").dataset.ready = String(page);
  show();
};
const asked_of = async (address, options = {}) => {
  const answer = await fetch(address, {
    ...options,
    headers: { "X-CSRF-Token": csrf, "Accept-Language": document.documentElement.lang, ...(options.body ? { "Content-Type": "application/json" } : {}), ...options.headers },
  });
  if (answer.status === 401) location.assign("/sign-in?next=" + encodeURIComponent(location.pathname));
  const said = answer.status === 204 ? {} : await answer.json();
  if (!answer.ok) return { problem: said.detail || said.title, kind: said.type };
  return { ...said, tag: answer.headers.get("ETag") };
};
const note = (text) => {
  one("desk-note").textContent = text;
  one("desk-note").hidden = !text;
};
viewer.addHandler("open", () => {
  note("");
  follow();
  desk.dataset.ready = String(page);
});
viewer.addHandler("update-viewport", follow);
viewer.addHandler("resize", follow);

// --- drawing what there is ---

const draw = () => {
  const px = per_px();
  const focused = svg.contains(document.activeElement) ? document.activeElement.dataset.at : null;
  svg.replaceChildren(hatching(px));
  for (const each of open_proposals()) {
    const outline = drawn("polygon", { points: corners(each.zone).join(" "), class: `proposed ${each.zone.kind}` });
    svg.append(outline);
  }
  const zones = here();
  for (const zone of [...zones].sort((a, b) => KINDS.indexOf(a.kind) - KINDS.indexOf(b.kind))) {
    const part = drawn("g", {
      class: `zone ${zone.kind}${zone === chosen ? " chosen" : ""}`,
      tabindex: "0",
      role: "button",
      "data-at": zones.indexOf(zone),
      "aria-pressed": String(zone === chosen),
      "aria-label": `${zone.name}, ${words["kind." + zone.kind]}, ${place(zone)}`,
    });
    part.append(drawn("polygon", { points: corners(zone).join(" "), class: "halo" }), drawn("polygon", { points: corners(zone).join(" ") }));
    svg.append(part);
  }
  name_all(zones, px);
  if (chosen && zones.includes(chosen)) svg.append(...handles(chosen, px));
  if (focused !== null) svg.querySelector(`[data-at="${focused}"]`)?.focus();
};
// Of two boxes: the area that they share.
const shared = ([x, y, width, height], [left, top, wide, high]) =>
  Math.max(Math.min(x + width, left + wide) - Math.max(x, left), 0) * Math.max(Math.min(y + height, top + high) - Math.max(y, top), 0);
// Each name lies in its zone, or beside it where it does not fit: where it hides least of other zones and names.
const name_all = (zones, px) => {
  const names = drawn("g", { class: "names", "aria-hidden": "true" });
  svg.append(names);
  const { x: left, y: top, width, height } = svg.viewBox.baseVal;
  const view = [left, top, width, height];
  const taken = [];
  for (const zone of zones) {
    const own = box(zone);
    if (!shared(own, view)) continue;
    const label = drawn("text", { "font-size": NAME_PX * px, "stroke-width": 4 * px });
    label.textContent = zone.name.length > NAME_LETTERS ? zone.name.slice(0, NAME_LETTERS - 1) + "…" : zone.name;
    names.append(label);
    const others = zones.filter((other) => other !== zone).map(box);
    const size = [label.getComputedTextLength(), 1.3 * NAME_PX * px];
    const hidden = (place) => [...others, ...taken].reduce((sum, other) => sum + shared(place, other), size[0] * size[1] - shared(place, view));
    const best = name_places(own, size, (zone === chosen ? HANDLE_PX + 4 : 5) * px).reduce((one, other) => (hidden(other) + px * px < hidden(one) ? other : one));
    label.setAttribute("x", best[0]);
    label.setAttribute("y", best[1] + NAME_PX * px);
    taken.push(best);
  }
};
const name_places = ([x, y, width, height], [wide, high], gap) => {
  const [above, below, at_right] = [y - high - gap, y + height + gap, x + width - wide];
  const beside = [[x, below], [x, above], [at_right, below], [at_right, above], [x + width + gap, y], [x - wide - gap, y]];
  const inside = wide + 2 * gap < width && high + 2 * gap < height ? [[x + gap, y + gap]] : [];
  return [...inside, ...beside].map((place) => [...place, wide, high]);
};
const hatching = (px) => {
  const pattern = drawn("pattern", { id: "hatch", width: 9 * px, height: 9 * px, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" });
  pattern.append(drawn("path", { d: `M0 0V${9 * px}`, "stroke-width": 3 * px }));
  const held = drawn("defs", {});
  held.append(pattern);
  return held;
};
const handles = (zone, px) => {
  const [x, y, width, height] = box(zone);
  const wide = width > 6 * HANDLE_PX * px;
  const high = height > 6 * HANDLE_PX * px;
  const found = [];
  for (const [name, across, along] of [["nw", 0, 0], ["n", 0.5, 0], ["ne", 1, 0], ["e", 1, 0.5], ["se", 1, 1], ["s", 0.5, 1], ["sw", 0, 1], ["w", 0, 0.5]]) {
    if ((name === "n" || name === "s") && !wide) continue;
    if ((name === "e" || name === "w") && !high) continue;
    const part = drawn("g", { class: `handle ${name}`, "data-handle": name });
    const at = { cx: x + across * width, cy: y + along * height };
    part.append(drawn("circle", { ...at, r: REACH_PX * px, class: "reach" }), drawn("circle", { ...at, r: HANDLE_PX * px }));
    found.push(part);
  }
  return found;
};
const show = () => {
  draw();
  const zones = here();
  list.replaceChildren(...zones.map((zone) => {
    const name = made("b", {}, zone.name);
    const facts = made("small", {}, `${words["kind." + zone.kind]} · ${place(zone)}`);
    const button = made("button", { type: "button", "aria-pressed": String(zone === chosen) }, made("i", { class: `swatch ${zone.kind}`, "aria-hidden": "true" }), made("span", {}, name, facts));
    button.addEventListener("click", () => choose(zone === chosen ? null : zone));
    return made("li", {}, button);
  }));
  if (!zones.length) list.append(made("li", { class: "small" }, words.none));
  const others = Draft.zones.length - zones.length;
  one("elsewhere").textContent = others ? put(words.elsewhere, { n: others }) : "";
  one("undo").disabled = !Draft.before.length;
  fill();
  const open = open_proposals();
  one("proposals").replaceChildren(...open.map((each) => {
    const accept = made("button", { type: "button", "aria-label": `${words.accept}: ${each.zone.name}` }, words.accept);
    const leave = made("button", { type: "button", "aria-label": `${words.leave}: ${each.zone.name}` }, words.leave);
    accept.addEventListener("click", () => add({ ...structuredClone(each.zone), pages: told.sizes_mm.length === 1 ? "all" : String(page) }));
    leave.addEventListener("click", () => { left.add(key_of(each)); show(); });
    const what = made("span", {}, made("b", {}, each.zone.name), made("small", {}, `${words["source." + each.source]} · ${words["kind." + each.zone.kind]} · ${place(each.zone)}`));
    return made("li", { class: "proposal" }, made("i", { class: `swatch ${each.zone.kind}`, "aria-hidden": "true" }), what, accept, leave);
  }));
  one("accept-all").hidden = open.length < 2;
  one("no-proposal").hidden = open.length > 0;
};
const fill = () => {
  const zone = here().includes(chosen) ? chosen : null;
  form.hidden = !zone;
  if (!zone) return;
  const [x, y, width, height] = box(zone);
  const values = { name: zone.name, kind: zone.kind, pages: zone.pages, x, y, width, height };
  for (const [name, value] of Object.entries(values)) {
    const field = form.elements[name];
    if (field !== document.activeElement || field.type === "number") field.value = value;
  }
};
const choose = (zone) => {
  chosen = zone;
  show();
};

// --- by fields ---

form.addEventListener("submit", (event) => event.preventDefault());
form.addEventListener("change", (event) => {
  if (!chosen) return;
  const { name, value } = event.target;
  const typed = value.trim();
  const ok = { name: typed, kind: KINDS.includes(typed), pages: typed === "all" || /^\d+(-\d+)?( *, *\d+(-\d+)?)*$/.test(typed) }[name] ?? (typed !== "" && Number.isFinite(Number(typed)));
  event.target.setCustomValidity(ok ? "" : words.wrong);
  if (!ok) { event.target.reportValidity(); return; }
  Draft.keep();
  if (["x", "y", "width", "height"].includes(name)) {
    const to = [...box(chosen)];
    to[["x", "y", "width", "height"].indexOf(name)] = Number(typed);
    set_box(chosen, fitting(to));
  } else if (name === "pages") chosen.pages = typed.replace(/\s/g, "");
  else chosen[name] = typed;
  Draft.changed();
});
one("delete").addEventListener("click", () => chosen && remove(chosen));
one("undo").addEventListener("click", () => Draft.undo());
one("add").addEventListener("click", () => {
  const { width, height } = size();
  const side = Math.min(30, width / 2, height / 2);
  const kind = KINDS.includes(tool) ? tool : "careful";
  add(new_zone(kind, fitting([(width - side) / 2, (height - side) / 2, side, side])));
  form.elements.name.focus();
  form.elements.name.select();
});
one("accept-all").addEventListener("click", () => {
  Draft.keep();
  for (const each of open_proposals()) Draft.zones.push({ ...structuredClone(each.zone), pages: told.sizes_mm.length === 1 ? "all" : String(page) });
  Draft.changed();
});

// --- by mouse and touch ---

let drag = null;
const point = (event) => {
  const frame = svg.getBoundingClientRect();
  const view = svg.viewBox.baseVal;
  return [view.x + ((event.clientX - frame.left) / frame.width) * view.width, view.y + ((event.clientY - frame.top) / frame.height) * view.height];
};
const resized = (name, [x, y, width, height], [dx, dy]) => {
  const right = x + width;
  const bottom = y + height;
  const west = name.includes("w") ? Math.min(x + dx, right - LEAST_MM) : x;
  const north = name.includes("n") ? Math.min(y + dy, bottom - LEAST_MM) : y;
  const east = name.includes("e") ? Math.max(right + dx, x + LEAST_MM) : right;
  const south = name.includes("s") ? Math.max(bottom + dy, y + LEAST_MM) : bottom;
  const begin = [Math.max(west, 0), Math.max(north, 0)];
  return fitting([...begin, east - begin[0], south - begin[1]]);
};
svg.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  if (drag) { give_up(); return; } // a second finger
  const handle = event.target.closest("[data-handle]")?.dataset.handle;
  const at = event.target.closest(".zone")?.dataset.at;
  const from = point(event);
  const drawing = KINDS.includes(tool);
  if (handle) drag = { how: handle, zone: chosen, from, begin: box(chosen), text: Draft.text() };
  else if (at !== undefined && !(drawing && here()[at] !== chosen)) {
    const zone = here()[at];
    drag = { how: "move", zone, from, begin: box(zone), text: Draft.text() };
    if (zone !== chosen) choose(zone);
  } else if (drawing) drag = { how: "draw", zone: null, from, text: Draft.text() };
  if (!drag) return;
  svg.setPointerCapture(event.pointerId);
  event.preventDefault();
});
svg.addEventListener("pointermove", (event) => {
  if (!drag) return;
  const to = point(event);
  const off = [to[0] - drag.from[0], to[1] - drag.from[1]];
  if (!drag.moved && Math.hypot(...off) < 4 * per_px()) return;
  drag.moved = true;
  if (drag.how === "draw") {
    const first = [Math.min(to[0], drag.from[0]), Math.min(to[1], drag.from[1])].map((value) => Math.max(value, 0));
    const last = [Math.max(to[0], drag.from[0]), Math.max(to[1], drag.from[1])];
    const area = fitting([...first, last[0] - first[0], last[1] - first[1]].map((value) => Math.round(value * 10) / 10));
    if (!drag.zone) {
      drag.zone = new_zone(tool, area);
      Draft.zones.push(drag.zone);
      chosen = drag.zone;
    } else drag.zone.rectangle_mm = area;
  } else if (drag.how === "move") {
    const [x, y, width, height] = drag.begin;
    set_box(drag.zone, fitting([Math.round((x + off[0]) * 10) / 10, Math.round((y + off[1]) * 10) / 10, width, height], true));
  } else set_box(drag.zone, resized(drag.how, drag.begin, off.map((value) => Math.round(value * 10) / 10)));
  draw();
  fill();
});
const give_up = () => {
  if (!drag) return;
  const text = drag.text;
  drag = null;
  Draft.zones = JSON.parse(text);
  chosen = null;
  show();
};
svg.addEventListener("pointerup", () => {
  if (!drag) return;
  const { moved, text } = drag;
  drag = null;
  if (!moved) return;
  Draft.before.push(text);
  if (KINDS.includes(tool)) choose_tool("look");
  Draft.changed();
});
svg.addEventListener("pointercancel", give_up);
svg.addEventListener("wheel", (event) => {
  event.preventDefault();
  const frame = svg.getBoundingClientRect();
  const at = viewer.viewport.pointFromPixel(new OpenSeadragon.Point(event.clientX - frame.left, event.clientY - frame.top));
  viewer.viewport.zoomBy(event.deltaY < 0 ? 1.2 : 1 / 1.2, at);
  viewer.viewport.applyConstraints();
}, { passive: false });

const choose_tool = (name) => {
  tool = name;
  desk.dataset.tool = name;
  for (const button of document.querySelectorAll("[data-tool][aria-pressed]")) button.setAttribute("aria-pressed", String(button.dataset.tool === name));
};
for (const button of document.querySelectorAll("button[data-tool]")) button.addEventListener("click", () => choose_tool(button.dataset.tool));
for (const button of document.querySelectorAll("button[data-zoom]")) {
  button.addEventListener("click", () => {
    if (button.dataset.zoom === "page") viewer.viewport.goHome();
    else viewer.viewport.zoomBy(button.dataset.zoom === "in" ? 1.5 : 1 / 1.5);
    viewer.viewport.applyConstraints();
  });
}
for (const button of document.querySelectorAll("button[data-turn]")) button.addEventListener("click", () => turn(page + Number(button.dataset.turn)));
one("page")?.addEventListener("change", (event) => turn(Number(event.target.value)));

// --- by keyboard ---

svg.addEventListener("focusin", (event) => {
  const at = event.target.closest(".zone")?.dataset.at;
  if (at !== undefined && here()[at] !== chosen) choose(here()[at]);
});
svg.addEventListener("keydown", (event) => {
  const zone = here()[event.target.closest(".zone")?.dataset.at];
  if (!zone || event.altKey || event.metaKey) return;
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const step = steps[event.key];
  if (step) {
    event.preventDefault();
    const by = step.map((value) => value * (event.ctrlKey ? FINE_MM : STEP_MM));
    const [x, y, width, height] = box(zone);
    Draft.keep();
    set_box(zone, event.shiftKey ? fitting([x, y, width + by[0], height + by[1]]) : fitting([x + by[0], y + by[1], width, height], true));
    Draft.changed();
  } else if (event.key === "Delete" || event.key === "Backspace") {
    event.preventDefault();
    remove(zone);
  } else if (event.key === "Enter" || event.key === " ") {
    event.preventDefault();
    form.elements.name.focus();
  }
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") {
    if (drag) give_up();
    else if (tool !== "look") choose_tool("look");
    else choose(null);
  }
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !event.target.matches("input, textarea")) {
    event.preventDefault();
    Draft.undo();
  }
});

Draft.begin();
choose_tool("look");
turn(1);
