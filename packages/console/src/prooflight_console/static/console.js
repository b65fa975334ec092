// What all pages do: theme, sound, menu, and the CSRF token with every change.
"use strict";

const one = (id) => document.getElementById(id);

// --- changes prove that they are meant ---

const csrf = document.querySelector('meta[name="csrf"]')?.content ?? "";
document.addEventListener("htmx:configRequest", (event) => {
  event.detail.headers["X-CSRF-Token"] = csrf;
});
document.addEventListener("htmx:responseError", (event) => {
  if (event.detail.xhr.status === 401) location.assign("/sign-in?next=" + encodeURIComponent(location.pathname));
});

// --- light or dark ---

one("theme")?.addEventListener("click", () => {
  const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = next;
  localStorage.setItem("theme", next);
  document.dispatchEvent(new Event("prooflight:theme"));
});

// --- from alarm to alarm: N opens the next one, arrows the neighbours, Z undoes a label; a list shows what was done to it ---

document.addEventListener("keydown", (event) => {
  if (event.target.closest("input, textarea, select, .pane") || event.ctrlKey || event.metaKey || event.altKey) return;
  const neighbour = { ArrowLeft: "prev", ArrowRight: "next" }[event.key];
  const sought = neighbour ? `a[rel="${neighbour}"]` : `[data-go="${CSS.escape(event.key.toUpperCase())}"]`;
  document.querySelector(sought)?.click();
});
document.addEventListener("htmx:afterRequest", (event) => {
  if (event.detail.successful && "reload" in event.target.dataset) location.reload();
});

// --- on a phone the cells of a long table name themselves, as its head is not shown ---

const name_cells = () => {
  for (const table of document.querySelectorAll("table.stack")) {
    const heads = [...table.tHead.rows[0].cells].map((head) => (head.querySelector(".unseen") ? "" : head.textContent.trim()));
    for (const cell of table.querySelectorAll("tbody td:not([colspan])")) if (heads[cell.cellIndex]) cell.dataset.label = heads[cell.cellIndex];
  }
};
name_cells();
document.addEventListener("htmx:afterSettle", name_cells);

// --- the menu closes by itself ---

document.addEventListener("click", (event) => {
  for (const menu of document.querySelectorAll("details.menu[open]")) {
    if (!menu.contains(event.target)) menu.open = false;
  }
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") for (const menu of document.querySelectorAll("details.menu[open]")) menu.open = false;
});

// --- a link's secret stands behind the #, so that no log has it ---

const welcome = one("welcome");
if (welcome) {
  const kept = location.hash.slice(1) || sessionStorage.getItem("welcome") || "";
  sessionStorage.setItem("welcome", kept);
  welcome.elements.secret.value = kept;
  if (kept) fetch("/welcome/name", { method: "POST", body: new URLSearchParams({ secret: kept }) })
    .then((answer) => (answer.ok ? answer.json() : null))
    .then((whose) => {
      if (!whose) return;
      one("welcome-who").querySelector("b").textContent = whose.name;
      one("welcome-who").hidden = false;
    })
    .catch(() => {});
  if (location.hash) history.replaceState(null, "", location.pathname);
}

// --- sound of alarms that nobody has answered ---

const Sound = {
  on: localStorage.getItem("sound") !== "off",
  context: null,
  timer: 0,
  alarm: false,
  show() {
    const button = one("sound");
    if (!button) return;
    const words = this.on ? button.dataset.on : button.dataset.off;
    button.setAttribute("aria-pressed", String(this.on));
    button.setAttribute("aria-label", words);
    button.title = words;
  },
  toggle() {
    this.on = !this.on;
    localStorage.setItem("sound", this.on ? "on" : "off");
    if (this.on) this.beep(660, 0.08);
    this.show();
    this.set(this.alarm);
  },
  set(alarm) {
    this.alarm = alarm;
    clearInterval(this.timer);
    if (alarm && this.on) {
      this.call();
      this.timer = setInterval(() => this.call(), 4000);
    }
  },
  unseen: 0,
  note(unseen) { // one soft tone for an alarm that does not stop the press
    if (unseen > this.unseen && this.on && !this.alarm) this.beep(520, 0.3);
    this.unseen = unseen;
  },
  call() {
    this.beep(880, 0.18);
    this.beep(660, 0.25, 0.22);
  },
  beep(hertz, seconds, after = 0) {
    if (!navigator.userActivation?.hasBeenActive) return; // until somebody touches the page, browsers allow no sound
    this.context ??= new AudioContext();
    if (this.context.state === "suspended") this.context.resume().catch(() => {});
    const at = this.context.currentTime + after;
    const tone = this.context.createOscillator();
    const loud = this.context.createGain();
    tone.frequency.value = hertz;
    loud.gain.setValueAtTime(0.0001, at);
    loud.gain.exponentialRampToValueAtTime(0.3, at + 0.02);
    loud.gain.exponentialRampToValueAtTime(0.0001, at + seconds);
    tone.connect(loud).connect(this.context.destination);
    tone.start(at);
    tone.stop(at + seconds + 0.05);
  },
};
one("sound")?.addEventListener("click", () => Sound.toggle());
Sound.show();

// --- the page Now: sheets and states as they come ---

const live = one("live");
if (live) {
  const words = JSON.parse(one("words").textContent);
  const strip = one("strip");
  const room = Number(strip.dataset.room);
  let held = null; // parts that wait while a finger is down: nothing moves away under it
  let down = 0;

  const put = (told) => {
    for (const [id, html] of Object.entries(told.parts)) {
      const part = one(id);
      if (!part || part.dataset.html === html) continue;
      const focused = part.contains(document.activeElement) ? document.activeElement.getAttribute("href") || document.activeElement.getAttribute("hx-post") : null;
      const asked = part.querySelector("details.ask-first")?.open; // what a person reads stays open
      part.innerHTML = html;
      part.dataset.html = html;
      htmx.process(part);
      if (asked) part.querySelector("details.ask-first")?.setAttribute("open", "");
      if (focused) part.querySelector(`[href="${CSS.escape(focused)}"], [hx-post="${CSS.escape(focused)}"]`)?.focus();
    }
    Sound.set(told.alarm);
    Sound.note(told.unseen);
    document.title = document.title.replace(/^(● )?/, told.alarm ? "● " : "");
  };
  const show = (told) => {
    if (down) held = told;
    else put(told);
  };
  document.addEventListener("pointerdown", () => { down += 1; });
  const up = () => setTimeout(() => {
    down = 0;
    if (held) { put(held); held = null; }
  }, 250);
  document.addEventListener("pointerup", up);
  document.addEventListener("pointercancel", up);

  const add = (sheet) => {
    const shown = strip.lastElementChild?.dataset.run;
    if (shown && shown !== String(sheet.run)) strip.replaceChildren();
    const known = strip.querySelector(`[data-sheet="${sheet.sheet}"]`);
    const cell = document.createElement("li");
    cell.className = sheet.verdict + (sheet.late ? " late" : "");
    cell.dataset.run = sheet.run;
    cell.dataset.sheet = sheet.sheet;
    const link = document.createElement("a");
    link.href = `/runs/${sheet.run}/sheets/${sheet.sheet}`;
    const kind = sheet.kind ? " · " + (words.kind[sheet.kind] ?? sheet.kind) : "";
    link.title = `${live.dataset.sheet} ${sheet.sheet} · ${words.verdict[sheet.verdict]}${kind}`;
    const number = document.createElement("span");
    number.className = "unseen";
    number.textContent = sheet.sheet;
    link.append(number);
    cell.append(link);
    if (known) known.replaceWith(cell);
    else strip.append(cell);
    while (strip.children.length > room) strip.firstElementChild.remove();
    if (sheet.pictured && !known) picture(sheet);
  };
  // The latest camera images, the latest first: of misprints and of the random sample, of which alone one is stored.
  const film = one("seen");
  const picture = (sheet) => {
    const last = film.firstElementChild?.dataset.run;
    if (last && last !== String(sheet.run)) film.replaceChildren();
    const cell = document.createElement("li");
    cell.dataset.run = sheet.run;
    const link = document.createElement("a");
    link.href = `/runs/${sheet.run}/sheets/${sheet.sheet}`;
    const image = document.createElement("img");
    image.src = `${link.href}/thumbnail`;
    image.alt = "";
    image.width = image.height = 88;
    link.append(image, sheet.sheet);
    cell.append(link);
    film.prepend(cell);
    while (film.children.length > Number(film.dataset.room)) film.lastElementChild.remove();
  };

  // EventSource comes again by itself and says the last id, so that no sheet is lost meanwhile.
  const events = new EventSource(`${live.dataset.events}?after=${live.dataset.after}`);
  events.addEventListener("sheet", (event) => {
    add(JSON.parse(event.data));
    live.dataset.last = event.lastEventId;
  });
  events.addEventListener("parts", (event) => show(JSON.parse(event.data)));
  events.addEventListener("gap", () => location.reload());
  events.addEventListener("end", () => location.assign("/sign-in?next=/"));
  events.addEventListener("open", () => { one("away").hidden = true; });
  events.addEventListener("error", () => {
    one("away").hidden = false;
    if (events.readyState === EventSource.CLOSED) setTimeout(() => location.reload(), 3000);
  });
  addEventListener("pagehide", () => events.close());
  Sound.set(live.dataset.alarm === "1");
  Sound.unseen = Number(live.dataset.unseen);
}
