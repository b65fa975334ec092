// The press over a run, drawn by uPlot: drift with limits, lost lines, how long inspections took; two runs alike.
"use strict";

const charts = document.getElementById("charts");
if (charts) {
  const words = JSON.parse(document.getElementById("chart-words").textContent);
  const HEIGHT = 230;
  const INKS = { cyan: ["#0086b3", "#35b8e8"], magenta: ["#c2187a", "#f06ab4"], yellow: ["#8f6d00", "#e6c02a"], black: ["#1c252c", "#d5dde3"] };
  const PLAIN = [["#14557f", "#6fb6e6"], ["#a4501a", "#f0a060"], ["#3b7d3a", "#7fd07c"], ["#6b4aa0", "#b598ea"], ["#7a6a1c", "#d9c65a"], ["#a02c46", "#f08aa0"]];
  const dark = () => (document.documentElement.dataset.theme === "dark" ? 1 : 0);
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const language = document.documentElement.lang;
  const number = (value, digits = 3) => (value == null ? "–" : new Intl.NumberFormat(language, { maximumSignificantDigits: digits }).format(value));
  const made = [];

  const element = (name, className, text) => {
    const one = document.createElement(name);
    if (className) one.className = className;
    if (text !== undefined) one.textContent = text;
    return one;
  };
  const nameOf = (channel) => {
    const parts = channel.split("-");
    const ink = parts.find((part) => part in INKS);
    if (ink) return words[ink];
    if (parts[0] === "lamp") return `${words.wave} ${parts[1]}`;
    return words[parts[1]] ?? parts.slice(1).join("-");
  };
  const colourOf = (channel, index) => {
    const ink = channel.split("-").find((part) => part in INKS);
    return (ink ? INKS[ink] : PLAIN[index % PLAIN.length])[dark()];
  };
  const key = (name, colour, dash) => {
    const item = element("li");
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", "0 0 22 8");
    svg.setAttribute("aria-hidden", "true");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
    line.setAttribute("d", "M0 4h22");
    line.setAttribute("stroke", colour);
    if (dash) line.setAttribute("stroke-dasharray", "5 4");
    svg.append(line);
    item.append(svg, element("span", "", name));
    return item;
  };
  const card = (course, name, unit) => {
    const box = element("section", "card chart");
    const title = element("h2", "", words[name]);
    title.append(element("small", "", `${words.run} ${course.run}${unit ? " · " + unit : ""}`));
    const keys = element("ul", "keys");
    const room = element("div", "room");
    room.setAttribute("role", "img");
    const readout = element("p", "readout");
    box.append(title, keys, room, readout);
    return { box, keys, room, readout, title: `${words[name]}, ${words.run} ${course.run}` };
  };
  const axes = (unit) => {
    const stroke = css("--dim");
    const grid = { stroke: css("--line"), width: 1 };
    const font = '13px "Inter", sans-serif';
    return [
      { stroke, grid: { show: false }, ticks: { stroke: css("--line"), size: 5 }, font, size: 30, values: (_, all) => all.map((value) => (value == null ? "" : number(value, 6))) },
      { stroke, grid, ticks: { show: false }, font, size: 62, values: (_, all) => all.map((value) => (value == null ? "" : number(value, 3))) },
    ];
  };
  const draw = (parts, options, data) => {
    const width = Math.max(parts.room.clientWidth, 240);
    const plot = new uPlot({ width, height: HEIGHT, legend: { show: false }, cursor: { points: { size: 7 }, drag: { x: true, y: false } }, ...options }, data, parts.room);
    made.push({ plot, room: parts.room });
    return plot;
  };

  // --- drift: the mean of each channel in a bin of sheets, and the limits beyond which a page is a misprint ---

  const drift = (course, name, range) => {
    const channels = course.charts[name] ?? [];
    const unit = channels[0]?.unit ?? "";
    const parts = card(course, name, unit);
    charts.append(parts.box);
    if (!channels.length || course.sheets.length < 2) {
      parts.room.replaceWith(element("p", "none", words.none));
      return;
    }
    const limits = [...new Set(channels.map((one) => one.tolerance).filter((one) => one != null))];
    const colours = channels.map((one, index) => colourOf(one.name, index));
    const series = [{ label: words.sheet }];
    channels.forEach((one, index) => {
      series.push({ label: nameOf(one.name), stroke: colours[index], width: 2, spanGaps: true, points: { show: course.sheets.length < 40, size: 5 } });
      parts.keys.append(key(nameOf(one.name), colours[index]));
    });
    if (limits.length) parts.keys.append(key(`${words.limit} ± ${number(limits[0])} ${unit}`, css("--stop"), true));
    parts.room.setAttribute("aria-label", `${parts.title}: ` + channels.map((one) => `${nameOf(one.name)} ${number(one.mean.findLast((value) => value != null))} ${unit}`).join(", "));
    const lines = (plot) => {
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.strokeStyle = css("--stop");
      ctx.lineWidth = devicePixelRatio * 1.5;
      ctx.setLineDash([6 * devicePixelRatio, 5 * devicePixelRatio]);
      for (const limit of limits) for (const at of [limit, -limit]) {
        const y = plot.valToPos(at, "y", true);
        if (y < bbox.top - 1 || y > bbox.top + bbox.height + 1) continue;
        ctx.beginPath();
        ctx.moveTo(bbox.left, y);
        ctx.lineTo(bbox.left + bbox.width, y);
        ctx.stroke();
      }
      ctx.restore();
    };
    const told = (plot) => {
      const at = plot.cursor.idx;
      parts.readout.textContent = at == null ? "" : `${words.sheet} ${course.sheets[at]}: ` + channels.map((one) => `${nameOf(one.name)} ${number(one.mean[at])}`).join(" · ");
    };
    draw(parts, { scales: { x: { time: false }, y: { range } }, axes: axes(), series, hooks: { draw: [lines], setCursor: [told] } }, [course.sheets, ...channels.map((one) => one.mean)]);
  };
  const rangeOf = (courses, name) => {
    let most = 0;
    for (const course of courses) for (const one of course.charts[name] ?? []) {
      most = Math.max(most, one.tolerance ?? 0);
      for (const value of one.mean) if (value != null) most = Math.max(most, Math.abs(value));
    }
    return [-1.12 * most || -1, 1.12 * most || 1];
  };

  // --- counts along the run, and times ---

  const bars = (share) => uPlot.paths.bars({ size: [share, 40, 2], gap: 1 });
  const troubles = (course, most) => {
    const parts = card(course, "troubles", words.sheets);
    charts.append(parts.box);
    const names = ["not-inspected", "late", "lost-lines"]; // the widest bars behind
    const colours = [css("--quiet"), css("--look-band"), css("--stop")];
    const series = [{ label: words.sheet }];
    names.forEach((name, index) => {
      const count = course.troubles[name].reduce((sum, one) => sum + one, 0);
      series.push({ label: words[name], stroke: colours[index], fill: colours[index], width: 0, paths: bars(1 - 0.3 * index), points: { show: false } });
      parts.keys.append(key(`${words[name]}: ${number(count, 9)}`, colours[index]));
    });
    parts.room.setAttribute("aria-label", parts.title + ": " + [...parts.keys.children].map((one) => one.textContent).join(", "));
    if (course.sheets.length < 2) {
      parts.room.replaceWith(element("p", "none", words.none));
      return;
    }
    const told = (plot) => {
      const at = plot.cursor.idx;
      parts.readout.textContent = at == null ? "" : `${words.sheet} ${course.sheets[at]}: ` + names.map((name) => `${words[name]} ${course.troubles[name][at]}`).join(" · ");
    };
    draw(parts, { scales: { x: { time: false }, y: { range: [0, Math.max(most, 4)] } }, axes: axes(), series, hooks: { setCursor: [told] } }, [course.sheets, ...names.map((name) => course.troubles[name])]);
  };
  const latency = (course, most) => {
    const parts = card(course, "latency", "ms");
    charts.append(parts.box);
    const { edges_ms: edges, counts, median_ms: median, p99_ms: p99 } = course.latency;
    if (median == null) {
      parts.room.replaceWith(element("p", "none", words.none));
      return;
    }
    const colour = PLAIN[0][dark()];
    const middles = counts.map((_, at) => Math.sqrt(edges[at] * edges[at + 1]));
    parts.keys.append(key(`${words.median} ${number(median)} ms`, css("--good"), true), key(`99 % ${number(p99)} ms`, css("--stop"), true));
    parts.room.setAttribute("aria-label", `${parts.title}: ${words.median} ${number(median)} ms, 99 % ${number(p99)} ms`);
    const marks = (plot) => {
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.lineWidth = devicePixelRatio * 2;
      ctx.setLineDash([6 * devicePixelRatio, 5 * devicePixelRatio]);
      for (const [at, stroke] of [[median, css("--good")], [p99, css("--stop")]]) {
        const x = plot.valToPos(at, "x", true);
        ctx.strokeStyle = stroke;
        ctx.beginPath();
        ctx.moveTo(x, bbox.top);
        ctx.lineTo(x, bbox.top + bbox.height);
        ctx.stroke();
      }
      ctx.restore();
    };
    const told = (plot) => {
      const at = plot.cursor.idx;
      parts.readout.textContent = at == null ? "" : `${number(edges[at])} – ${number(edges[at + 1])} ms: ${counts[at]} ${words.sheets}`;
    };
    const [across, up] = axes();
    const steps = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000];
    const filled = counts.map((count, at) => (count ? at : -1)).filter((at) => at >= 0);
    const ends = [edges[Math.max(filled[0] - 3, 0)], edges[Math.min(filled[filled.length - 1] + 4, edges.length - 1)]];
    across.splits = () => steps.filter((one) => one >= ends[0] && one <= ends[1]);
    across.filter = (_, all) => all;
    draw(parts, {
      scales: { x: { time: false, distr: 3, range: ends }, y: { range: [0, most * 1.08] } },
      axes: [across, up],
      series: [{ label: "ms" }, { label: words.sheets, stroke: colour, fill: colour, width: 0, paths: bars(0.9), points: { show: false } }],
      hooks: { draw: [marks], setCursor: [told] },
    }, [middles, counts]);
  };

  // --- all of them, side by side where there are two runs ---

  const show = (courses) => {
    for (const { plot } of made.splice(0)) plot.destroy();
    charts.replaceChildren();
    const names = ["density", "register-x", "register-y", "shift", "light", "lamp"].filter((name) => courses.some((course) => course.charts[name]));
    for (const name of names) {
      const range = rangeOf(courses, name);
      for (const course of courses) drift(course, name, range);
    }
    const most = Math.max(1, ...courses.flatMap((course) => Object.values(course.troubles).flat()));
    for (const course of courses) troubles(course, most);
    const high = Math.max(1, ...courses.flatMap((course) => course.latency.counts));
    for (const course of courses) latency(course, high);
    charts.dataset.ready = "1";
  };
  const load = async () => {
    try {
      const courses = [];
      for (const run of charts.dataset.runs.split(",")) {
        const answer = await fetch(`/press/${run}/course`);
        if (!answer.ok) throw new Error(String(answer.status));
        courses.push(await answer.json());
      }
      show(courses);
      document.addEventListener("prooflight:theme", () => show(courses));
    } catch {
      charts.replaceChildren(element("p", "card empty", words.failed));
    }
  };
  let width = innerWidth;
  addEventListener("resize", () => {
    if (width === innerWidth) return;
    width = innerWidth;
    for (const { plot, room } of made) plot.setSize({ width: Math.max(room.clientWidth, 240), height: HEIGHT });
  });
  load();
}
