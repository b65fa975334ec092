// The price of zones: asked, followed, cancelled, shown; and saving, which needs a price of exactly what is drawn.
"use strict";

const ask = one("ask");
const PRICE = `zones:price:${told.job}`;

const Price = {
  task: null, // as the console told it last
  key: null, // of what it is a price of
  busy: false, // while it is asked for or saved
};
const body = () => {
  const { press, share, prints, trials } = ask.elements;
  return {
    zones: Draft.zones,
    careful_share: Number(share.value) / 100,
    press: press.value || null,
    prints: Number(prints.value),
    trials: Number(trials.value),
  };
};
const key = () => JSON.stringify(body());
const as_saved = () => Draft.text() === JSON.stringify(told.saved.zones) && Number(ask.elements.share.value) === Math.round(told.saved.careful_share * 100);
const priced = () => Price.task?.state === "done" && Price.key === key();
const running = () => Price.task?.state === "running";

// --- what stands there ---

const refresh = () => {
  const empty = !Draft.zones.length;
  const saved = as_saved();
  one("ask-price").disabled = empty || running() || Price.busy || priced();
  one("progress").hidden = !running();
  if (running()) {
    const { stage, done, total } = Price.task;
    one("bar").value = stage === "starting" ? 0 : done / Math.max(total, 1);
    one("bar-text").textContent = put(words["stage." + stage], { done, total });
  }
  const save = one("save");
  const may_remove = empty && told.saved.zones.length > 0;
  save.disabled = Price.busy || !(may_remove || (priced() && !(saved && told.saved.in_force && Price.task.press_digest === told.saved.press_digest)));
  save.textContent = may_remove ? words.remove : words.save;
  one("why-not").textContent = may_remove ? "" : empty ? words["why.empty"] : saved && told.saved.in_force ? words["why.saved"] : priced() ? "" : running() ? "" : words["why.unpriced"];
  const table = one("price");
  if (priced()) table.replaceChildren(...told_price(Price.task.price));
  else if (saved && told.saved.in_force && told.saved.price.length) table.replaceChildren(...told_price({ zones: told.saved.price }));
  else if (Price.task?.state === "done" && Price.task.price) table.replaceChildren(made("p", { class: "note look" }, words.stale));
  else table.replaceChildren();
  document.body.dataset.price = priced() ? "done" : Price.task?.state ?? "none";
};
const trouble = (text) => {
  one("wrong").textContent = text;
  one("wrong").hidden = !text;
};

// --- the price as a table ---

const least = (told_of, unit) => {
  if (!told_of) return "–";
  if (told_of.least === null) return words.never;
  return `${shown(told_of.least, told_of.least < 10 ? 1 : 0)} ${unit}`;
};
const between = (told_of, unit) => {
  if (!told_of || told_of.least === null) return "";
  const high = told_of.high === null ? words.beyond : shown(told_of.high, told_of.high < 10 ? 1 : 0);
  return `${shown(told_of.low, told_of.low < 10 ? 1 : 0)} – ${high} ${unit}`;
};
// Which way a figure went: what is caught smaller is a gain.
const change = (before, after) => {
  if (!before || !after || (before.least === null && after.least === null)) return ["", ""];
  if (after.least === null) return ["loss", words.lost];
  if (before.least === null) return ["gain", words.won];
  const share = Math.round(100 * (after.least / before.least - 1));
  if (Math.abs(share) < 3) return ["", "±0 %"];
  return [share > 0 ? "loss" : "gain", `${share > 0 ? "+" : "−"}${Math.abs(share)} %`];
};
const told_price = (price) => {
  const rows = [];
  for (const area of price.zones) {
    const name = area.kind === "rest" ? words.rest : area.name;
    rows.push(made("tr", { class: area.kind === "rest" ? "area rest" : "area" }, made("th", { colspan: "4", scope: "rowgroup" }, made("i", { class: `swatch ${area.kind}`, "aria-hidden": "true" }), name, made("small", {}, area.kind === "rest" ? words["rest.what"] : words["kind." + area.kind]))));
    for (const { name: sort, unit, what } of told.sorts) {
      if (!(sort in area.before)) continue;
      const [way, by] = change(area.before[sort], area.after[sort]);
      const cells = [area.before[sort], area.after[sort]].map((part) => made("td", { class: "n" }, least(part, unit), made("small", {}, between(part, unit))));
      rows.push(made("tr", {}, made("td", {}, what), ...cells, made("td", { class: `n ${way}` }, by)));
    }
  }
  const head = made("tr", {}, ...[words.sort, words.before, words.after, words.change].map((text, at) => made("th", { scope: "col", ...(at ? { class: "n" } : {}) }, text)));
  const table = made("table", { class: "price-table" }, made("thead", {}, head), made("tbody", {}, ...rows));
  const said = price.zones.length ? [made("h3", {}, words.caught), made("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": words.caught }, table)] : [];
  if (price.promised === undefined) return said;
  said.push(made("h3", {}, words.alarms), made("p", {}, put(words["alarms.promised"], { n: shown(1 / price.promised, 0) })));
  said.push(made("p", { class: "small" }, put(words["alarms.seen"], { good: price.good_prints, before: price.alarmed_before, after: price.alarmed_after })));
  if (price.extrapolated) said.push(made("p", { class: "small" }, words["alarms.tail"]));
  return said;
};

// --- asked, followed, cancelled ---

const followed = async (id) => {
  while (Price.task?.id === id && running()) {
    const { stage, done } = Price.task;
    const now = await asked_of(`/api/v1/zones/prices/${id}?seen=${encodeURIComponent(`${stage}:${done}`)}`).catch(() => null);
    if (now === null) { await new Promise((after) => setTimeout(after, 2000)); continue; } // the console is away for a moment
    if (Price.task?.id !== id) return;
    if (now.problem) { Price.task = null; trouble(now.problem); break; }
    Price.task = now;
    if (now.state === "failed") trouble(now.why);
    refresh();
  }
  refresh();
};
ask.addEventListener("submit", async (event) => {
  event.preventDefault();
  trouble("");
  const asked = key();
  Price.busy = true;
  refresh();
  const task = await asked_of(`/api/v1/jobs/${told.job}/zones/prices`, { method: "POST", body: asked });
  Price.busy = false;
  if (task.problem) trouble(task.problem);
  else {
    Price.task = task;
    Price.key = asked;
    sessionStorage.setItem(PRICE, JSON.stringify({ id: task.id, key: asked }));
    if (running()) followed(task.id);
  }
  refresh();
});
one("cancel").addEventListener("click", async () => {
  if (!running()) return;
  const now = await asked_of(`/api/v1/zones/prices/${Price.task.id}`, { method: "DELETE" });
  if (now.problem) trouble(now.problem);
  else Price.task = now;
  refresh();
});

// --- saved ---

one("save").addEventListener("click", async () => {
  trouble("");
  Price.busy = true;
  refresh();
  const address = `/api/v1/jobs/${told.job}/zones`;
  const meant = { "If-Match": told.tag };
  const { prints: _prints, trials: _trials, ...zones } = body();
  const empty = !Draft.zones.length;
  const saved = await asked_of(address, empty ? { method: "DELETE", headers: meant } : { method: "PUT", headers: meant, body: JSON.stringify(zones) });
  Price.busy = false;
  if (saved.problem) trouble(saved.problem);
  else {
    sessionStorage.removeItem(DRAFT);
    const now = empty ? await asked_of(address) : saved;
    told.saved = now;
    told.tag = now.tag;
    Draft.zones = structuredClone(now.zones);
    chosen = null;
    show();
    document.body.dataset.saved = "1";
  }
  refresh();
});

ask.elements.share.value = String(Math.round(told.saved.careful_share * 100));
document.addEventListener("prooflight:zones", () => { delete document.body.dataset.saved; refresh(); });
ask.addEventListener("input", refresh);
{
  // What was under way when this page was left, or what somebody else asked for.
  const kept = JSON.parse(sessionStorage.getItem(PRICE) ?? "null");
  const known = told.prices.find((task) => task.id === kept?.id) ?? told.prices.find((task) => task.state === "running");
  if (known) {
    Price.task = { ...known };
    Price.key = known.id === kept?.id ? kept.key : null;
    if (running()) followed(known.id);
    else if (known.state === "done") asked_of(`/api/v1/zones/prices/${known.id}`).then((task) => { if (!task.problem) { Price.task = task; refresh(); } });
  }
}
refresh();
