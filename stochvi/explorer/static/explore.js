// The panel: knobs, answers, two pictures and the moving mass. It shows what it is sent, and asks
// by messages alone, so that a notebook's model and the page's (`page.js`) serve it alike.

const UNITS = {
  mm: { m: [1e3, "mm"], "m/s": [1e3, "mm/s"] },
  in: { m: [1 / 0.0254, "in"], "m/s": [1 / 0.0254, "in/s"] },
};
const STAGES = { closed: "closed forms", simulated: "simulated", refined: "refined" };
const SLOW = 12; // how much slower than it is the motion moves
const LIT = 0.25; // s for which a stop stays lit

const element = (tag, attributes = {}, ...inside) => {
  const made = Object.assign(document.createElement(tag), attributes);
  made.append(...inside);
  return made;
};

function digits(value, count = 3) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-3 ? value.toExponential(count - 1) : count > 3 ? value.toPrecision(count) : String(Number(value.toPrecision(count)));
}

const TIMES = [[3600, "h"], [60, "min"], [1, "s"]];

// the factor from SI units to those that are shown, and their name; a time has the largest that it fills
function unitOf(unit, system, value) {
  if (unit !== "s") return UNITS[system][unit] ?? [1, unit];
  const [seconds, name] = TIMES.find(([each]) => value >= each) ?? TIMES[2];
  return [1 / seconds, name];
}

function spoken(value, unit, system, count = 3) {
  const [factor, shown] = unitOf(unit, system, value);
  return `${digits(value * factor, count)} ${shown}`.trim();
}

// with as many digits as tell the ends of the interval apart
function withInterval(number, system) {
  const { value, low, high, unit } = number;
  if (low === undefined || low === high) return spoken(value, unit, system);
  const [factor, shown] = unitOf(unit, system, value);
  const count = [3, 4, 5, 6].find((n) => digits(low * factor, n) !== digits(high * factor, n)) ?? 6;
  const [middle, ...ends] = [value, low, high].map((each) => digits(each * factor, count));
  return `${middle} (${ends.join(" to ")}) ${shown}`.trim();
}

// stops that are as far away on both sides are turned together
function oneClearance(knobs) {
  const [lower, upper] = ["lower", "upper"].map((side) => knobs.find((each) => each.key === `impact_pair.0.${side}`));
  if (!lower || !upper || lower.value !== -upper.value) return knobs;
  const both = { ...upper, key: "clearance", words: "clearance per side", keys: [lower.key, upper.key], signs: { [lower.key]: -1 } };
  return knobs.filter((each) => each !== lower).map((each) => (each === upper ? both : each));
}

// a knob: a slider whose ends are those of the schema, and its number, which can be typed
function knobRow(knob, system, turned) {
  const [factor, unit] = unitOf(knob.unit, system, knob.value);
  const place = (value) => (knob.logarithmic ? Math.log(value) : value);
  const back = (at) => (knob.logarithmic ? Math.exp(at) : at);
  const name = unit ? `${knob.words}, ${unit}` : knob.words;
  const range = element("input", { type: "range", min: 0, max: 1000, step: 1, id: knob.key });
  const typed = element("input", { type: "number", step: "any" });
  typed.setAttribute("aria-label", `${name}, typed`);
  const width = place(knob.high) - place(knob.low);
  const show = () => {
    range.value = Math.round((1000 * (place(knob.now) - place(knob.low))) / width);
    range.setAttribute("aria-valuetext", spoken(knob.now, knob.unit, system));
    typed.value = digits(knob.now * factor);
  };
  range.addEventListener("input", () => {
    knob.now = back(place(knob.low) + (width * range.value) / 1000);
    show();
    turned();
  });
  typed.addEventListener("change", () => {
    const value = typed.valueAsNumber / factor;
    if (Number.isFinite(value)) knob.now = Math.min(Math.max(value, knob.low), knob.high);
    show();
    turned();
  });
  knob.show = show;
  show();
  return element("div", { className: "knob" }, element("label", { htmlFor: knob.key, textContent: name }), range, typed);
}

// a picture over clearance on a logarithmic axis
function chart(title, series, colours, label, system) {
  const factor = UNITS[system].m[0];
  const axis = { stroke: colours.ink, grid: { stroke: colours.line, width: 1 }, ticks: { stroke: colours.line } };
  const power = (value) => (value >= 0.01 && value < 1e4 ? digits(value) : `1e${Math.round(Math.log10(value))}`);
  const box = element("div", { className: "chart" });
  const options = {
    width: 500, height: 280, legend: { live: false },
    cursor: { drag: { x: false, y: false } },
    scales: { x: { time: false }, y: { distr: 3 } },
    axes: [
      { ...axis, label: `clearance, ${UNITS[system].m[1]}` },
      { ...axis, label, size: 64, splits: decades, filter: (_, places) => places, values: (_, places) => places.map(power) },
    ],
    series: [{}, ...series.map((each) => ({ spanGaps: true, points: { show: false }, ...each }))],
    hooks: {
      draw: [(u) => {
        const { ctx, bbox } = u;
        for (const { at, colour, name } of picture.marks) {
          const x = u.valToPos(at * factor, "x", true);
          if (!(x > bbox.left && x < bbox.left + bbox.width)) continue;
          ctx.save();
          ctx.strokeStyle = ctx.fillStyle = colour;
          ctx.setLineDash([6, 4]);
          ctx.lineWidth = 2 * devicePixelRatio;
          ctx.beginPath();
          ctx.moveTo(x, bbox.top);
          ctx.lineTo(x, bbox.top + bbox.height);
          ctx.stroke();
          ctx.translate(x + 4 * devicePixelRatio, bbox.top + bbox.height - 6 * devicePixelRatio);
          ctx.rotate(-Math.PI / 2);
          ctx.font = `${12 * devicePixelRatio}px sans-serif`;
          ctx.textBaseline = "top";
          ctx.textAlign = "left";
          ctx.fillText(name, 0, 0);
          ctx.restore();
        }
      }],
    },
  };
  const picture = {
    marks: [],
    box: element("figure", {}, element("figcaption", { textContent: title }), box),
    set(clearances, rows) {
      const data = [clearances.map((each) => each * factor), ...rows];
      picture.plot ??= new uPlot(options, data, box);
      picture.plot.setData(data);
    },
    resize(width) {
      picture.plot?.setSize({ width: Math.max(width, 240), height: 280 });
    },
  };
  return picture;
}

// places of the grid of a logarithmic axis: whole decades, at most about eight of them
function decades(u, axis, low, high) {
  const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9);
  const step = Math.ceil((last - first + 1) / 8);
  const places = [];
  for (let each = first; each <= last; each += step) places.push(10 ** each);
  return places;
}

// rows over different places, as one table with gaps
function table(parts) {
  const places = [...new Set(parts.flatMap(([at]) => at))].sort((a, b) => a - b);
  const index = new Map(places.map((place, i) => [place, i]));
  const rows = parts.map(([at, values]) => {
    const row = new Array(places.length).fill(null);
    at.forEach((place, i) => (row[index.get(place)] = values[i] > 0 ? values[i] : null));
    return row;
  });
  return [places, rows];
}

function drawMotion(canvas, path, stops, seconds, lit, colours) {
  const ctx = canvas.getContext("2d");
  const { width, height } = canvas;
  ctx.clearRect(0, 0, width, height);
  const reach = 1.25 * Math.max(...[stops.lower, stops.upper].filter((x) => x !== undefined).map(Math.abs), 1e-9);
  const mass = height * 0.34;
  const at = (x) => width / 2 + (x / reach) * (width / 2 - mass / 2);
  const step = path.time[1] - path.time[0];
  const place = (seconds / step) % (path.time.length - 1);
  const i = Math.floor(place);
  const x = path.displacement[i] + (place - i) * (path.displacement[i + 1] - path.displacement[i]);
  if (path.impact_speed[i] > 0) lit.upper = performance.now();
  if (path.impact_speed[i] < 0) lit.lower = performance.now();
  ctx.fillStyle = colours.line;
  ctx.fillRect(0, height / 2 + mass / 2, width, 3);
  for (const [side, sign] of [["lower", -1], ["upper", 1]]) {
    if (stops[side] === undefined) continue;
    const glows = performance.now() - (lit[side] ?? -1e9) < 1e3 * LIT;
    ctx.fillStyle = glows ? colours.hit : colours.soft;
    ctx.fillRect(at(stops[side]) + (sign * mass) / 2 - (sign < 0 ? 10 : 0), height * 0.15, 10, height * 0.7);
  }
  ctx.fillStyle = colours.mass;
  ctx.fillRect(at(x) - mass / 2, height / 2 - mass / 2, mass, mass);
  ctx.strokeStyle = colours.ink;
  ctx.lineWidth = 2;
  ctx.strokeRect(at(x) - mass / 2, height / 2 - mass / 2, mass, mass);
}

function render({ model, el }) {
  const tab = Math.random().toString(36).slice(2);
  let system = "mm", knobs = [], profile = null, id = 0, asked = 0, answer = { numbers: {}, dots: [] }, path = null, lit = {}, charts = null, timer = null;
  const colour = (name) => getComputedStyle(el).getPropertyValue(`--${name}`).trim();
  const colours = () => Object.fromEntries(["ink", "line", "soft", "mass", "hit", "rice", "closure", "simulated", "first", "answer", "three"].map((name) => [name, colour(name)]));
  const heading = element("h1", { textContent: "stochvi explore" });
  const sentence = element("p", { className: "answer" });
  sentence.setAttribute("role", "status");
  const state = element("p", { className: "state", textContent: "compiling what the first turn needs" });
  const panel = element("form", { className: "knobs" });
  panel.addEventListener("submit", (event) => event.preventDefault());
  panel.setAttribute("aria-label", "knobs");
  const numbers = element("tbody");
  const results = element("table", {}, element("caption", { textContent: "Numbers, with 95 % intervals" }),
    element("thead", {}, element("tr", {}, ...["quantity", "value", "method"].map((each) => element("th", { scope: "col", textContent: each })))), numbers);
  const pictures = element("div", { className: "pictures" });
  const canvas = element("canvas", { width: 900, height: 150 });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The mass moving between its stops, slowed down; a stop lights up when it is hit");
  const moving = element("figure", {}, element("figcaption", { textContent: `One simulated path between the stops, ${SLOW} times slower; a stop lights up when it is hit` }), canvas);
  const units = element("select", { id: "units" }, ...Object.keys(UNITS).map((each) => element("option", { textContent: each })));
  const chosen = element("div", { className: "choices" }, element("label", { htmlFor: "units", textContent: "lengths in" }), units);
  el.classList.add("stochvi-explore");
  el.replaceChildren(element("header", {}, heading, sentence, state), element("main", {}, element("section", { className: "side" }, chosen, panel),
    element("section", { className: "shown" }, moving, pictures, results)));

  const now = (key) => {
    const knob = knobs.find((each) => each.keys.includes(key));
    return knob && knob.now * (knob.signs?.[key] ?? 1);
  };
  const stops = () => Object.fromEntries(["lower", "upper"].map((side) => [side, now(`impact_pair.0.${side}`)]));

  function turn() {
    id += 1;
    asked = performance.now();
    answer = { numbers: {}, dots: [] };
    state.textContent = "asking";
    el.classList.add("stale"); // what is shown belongs to an earlier turn
    const values = Object.fromEntries(knobs.flatMap((each) => each.keys.map((key) => [key, each.now * (each.signs?.[key] ?? 1)])));
    model.send({ type: "turn", id, tab, values, profile });
  }
  const turned = () => {
    clearTimeout(timer);
    timer = setTimeout(turn, 15); // a slider that is dragged sends many events
  };

  function begin() {
    const c = colours();
    const line = { width: 2 };
    const dots = { width: 0, points: { show: true, size: 8, fill: c.simulated }, stroke: c.simulated };
    charts = {
      risk: chart("Probability of any impact in the mission, over clearance", [
        { label: "first crossings", stroke: c.first, ...line },
        { label: "95 % interval", stroke: c.first, width: 1, dash: [2, 3] },
        { class: "unlisted", stroke: c.first, width: 1, dash: [2, 3] },
        { label: "accepted", stroke: c.answer, width: 1, dash: [8, 4] },
      ], c, "probability", system),
      rate: chart("Impacts per second, over clearance", [
        { label: "Rice", stroke: c.rice, dash: [8, 5], ...line },
        { label: "closure", stroke: c.closure, ...line },
        { label: "simulated", ...dots },
        { label: "95 % interval", ...dots, points: { show: true, size: 3, fill: c.simulated } },
        { class: "unlisted", ...dots, points: { show: true, size: 3, fill: c.simulated } },
      ], c, "impacts, 1/s", system),
    };
    pictures.replaceChildren(charts.risk.box, charts.rate.box);
    paint();
  }

  function paint() {
    if (!charts) return;
    const c = colours();
    const own = Math.min(...Object.values(stops()).filter((x) => x !== undefined).map(Math.abs));
    const marks = [{ at: own, colour: c.ink, name: "your stops" }];
    if (answer.three) marks.push({ at: answer.three, colour: c.three, name: "three sigma" });
    if (answer.required) marks.push({ at: answer.required, colour: c.answer, name: "required" });
    charts.risk.marks = charts.rate.marks = marks;
    if (answer.curve) {
      const { clearance, probability, probability_low, probability_high } = answer.curve;
      const most = (row) => row.map((each) => (each > 1e-12 ? each : null));
      charts.risk.set(clearance, [most(probability), most(probability_low), most(probability_high), clearance.map(() => now("probability"))]);
    }
    if (answer.rice) {
      const found = answer.dots;
      const rate = answer.numbers["simulated impact rate"];
      const at = found.map((each) => each.clearance), simulated = found.map((each) => each.simulated);
      if (rate) { at.push(own); simulated.push(rate); }
      const closed = found.filter((each) => each.closure);
      const kept = answer.rice.map((each) => (each > 1e-9 ? each : null));
      charts.rate.set(...table([[answer.clearances, kept], [closed.map((each) => each.clearance), closed.map((each) => each.closure.value)],
        [at, simulated.map((each) => each.value)], [at, simulated.map((each) => each.low)], [at, simulated.map((each) => each.high)]]));
    }
    fit();
    numbers.replaceChildren(...Object.values(answer.numbers).map((each) => element("tr", {},
      element("th", { scope: "row", textContent: each.name }), element("td", { textContent: withInterval(each, system) }), element("td", { textContent: each.method }))));
  }

  const fit = () => charts && [charts.risk, charts.rate].forEach((each) => each.resize(each.box.clientWidth - 8));

  const heard = {
    knobs(message) {
      knobs = oneClearance(message.knobs.map((each) => ({ ...each, keys: [each.key] }))).map((each) => ({ ...each, now: each.value }));
      profile = message.profile;
      heading.textContent = message.title || "stochvi explore";
      if (message.profiles.length) {
        const choice = element("select", { id: "profile" }, ...message.profiles.map((each) => element("option", { textContent: each, selected: each === profile })));
        choice.addEventListener("change", () => { profile = choice.value; turned(); });
        chosen.append(element("label", { htmlFor: "profile", textContent: "profile" }), choice);
      }
      panel.replaceChildren(...knobs.map((each) => knobRow(each, system, turned)));
      begin();
      turn();
    },
    answer(message) {
      if (message.id !== id) return;
      if (message.missing) {
        answer.missing = message.missing;
        state.textContent = message.missing;
        if (message.part === "risk") sentence.textContent = "";
        return;
      }
      for (const each of message.numbers ?? []) if (each) answer.numbers[each.name] = each;
      if (message.part === "linear") Object.assign(answer, { three: message.three_sigma, clearances: message.clearances, rice: message.rice });
      if (message.part === "risk") { Object.assign(answer, { curve: message.curve, required: message.numbers[0].value }); sentence.textContent = message.sentence; el.classList.remove("stale"); }
      if (message.part === "motion") path = message.path;
      if (message.part === "dot") answer.dots.push(message);
      state.textContent = `${STAGES[message.stage]}, ${Math.round(performance.now() - asked)} ms after the turn`;
      paint();
      el.dispatchEvent(new CustomEvent("painted", { detail: { ...message, milliseconds: performance.now() - asked } }));
    },
    done(message) {
      if (message.id === id) state.textContent = answer.missing ?? `all known, ${digits((performance.now() - asked) / 1e3)} s after the turn`;
    },
    refused(message) {
      if (message.id !== undefined && message.id !== id) return;
      state.textContent = message.sentence;
      sentence.textContent = ""; // that of the turn before does not hold here
    },
    ended() {
      state.textContent = "stochvi explore has ended; start it anew";
    },
  };
  model.on("msg:custom", (message) => heard[message.type]?.(message));
  units.addEventListener("change", () => {
    system = units.value;
    panel.replaceChildren(...knobs.map((each) => knobRow(each, system, turned)));
    begin();
  });
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", begin);
  addEventListener("resize", fit);
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const began = performance.now();
  let live = true;
  (function frame() {
    if (!live) return;
    if (path) drawMotion(canvas, path, stops(), still.matches ? 0 : (performance.now() - began) / 1e3 / SLOW, lit, colours());
    requestAnimationFrame(frame);
  })();
  model.send({ type: "open" });
  return () => { live = false; removeEventListener("resize", fit); dark.removeEventListener("change", begin); };
}

export default { render };
