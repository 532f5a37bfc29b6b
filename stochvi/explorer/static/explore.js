// The panel: what a design does, its knobs and pictures. It shows what it is sent, and asks by
// messages alone, so that a notebook's model and the page's (`page.js`) serve it alike. The model
// keeps two things: the `setting` of the knobs, and the `pinned` design.
import { SYSTEMS, change, digits, element, inUnits, spoken, unitOf, withInterval } from "./figures.js";
import { motion } from "./motion.js";
import { picture } from "./pictures.js";

const STAGES = { closed: "closed forms", simulated: "simulated", refined: "refined" };
const SIDES = { lower: -1, upper: 1 };
const stopKey = (side) => `impact_pair.0.${side}`;

// stops that are as far away on both sides are turned together
function oneClearance(knobs) {
  const [lower, upper] = Object.keys(SIDES).map((side) => knobs.find((each) => each.key === stopKey(side)));
  if (!lower || !upper || lower.value !== -upper.value) return knobs;
  const both = { ...upper, key: "clearance", words: "clearance per side", keys: [lower.key, upper.key], signs: { [lower.key]: -1 } };
  return knobs.filter((each) => each !== lower).map((each) => (each === upper ? both : each));
}

// a knob: a slider whose ends are those of the server, and its number, which can be typed
function knobRow(knob, system, turned, tell) {
  const place = (value) => (knob.logarithmic ? Math.log(value) : value);
  const back = (at) => (knob.logarithmic ? Math.exp(at) : at);
  const range = element("input", { type: "range", min: 0, max: 1000, step: 1, id: knob.key });
  const typed = element("input", { type: "number", step: "any" });
  const label = element("label", { htmlFor: knob.key });
  const width = place(knob.high) - place(knob.low);
  const show = () => {
    const [factor, unit] = unitOf(knob.unit, system(), knob.now);
    label.textContent = unit ? `${knob.words}, ${unit}` : knob.words;
    typed.setAttribute("aria-label", `${label.textContent}, typed`);
    range.value = Math.round((1000 * (place(knob.now) - place(knob.low))) / width);
    range.setAttribute("aria-valuetext", spoken(knob.now, knob.unit, system()));
    typed.value = digits(knob.now * factor, 4).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
  };
  range.addEventListener("input", () => {
    knob.now = back(place(knob.low) + (width * range.value) / 1000);
    show();
    turned();
  });
  typed.addEventListener("change", () => {
    const value = typed.valueAsNumber / unitOf(knob.unit, system(), knob.now)[0];
    if (Number.isFinite(value)) knob.now = Math.min(Math.max(value, knob.low), knob.high);
    show();
    turned();
    tell(value === knob.now ? "" : `${knob.words} goes from ${spoken(knob.low, knob.unit, system())} to ${spoken(knob.high, knob.unit, system())}`);
  });
  knob.show = show;
  show();
  return element("div", { className: "knob" }, label, range, typed);
}

const choice = (id, words, options, now) =>
  [element("label", { htmlFor: id, textContent: words }), element("select", { id }, ...options.map((each) => element("option", { textContent: each, selected: each === now })))];

const button = (words, pressed) => {
  const made = element("button", { type: "button", textContent: words });
  made.addEventListener("click", pressed);
  return made;
};

function tableOf(caption, heads, className) {
  const body = element("tbody");
  const head = element("tr", {}, ...heads.map((each) => element("th", { scope: "col", textContent: each })));
  return [element("table", { className }, element("caption", { textContent: caption }), element("thead", {}, head), body), body];
}

const row = (name, ...cells) => element("tr", {}, element("th", { scope: "row", textContent: name }), ...cells.map((each) => element("td", { textContent: each })));

function render({ model, el }) {
  const tab = Math.random().toString(36).slice(2);
  let system = "mm, g", knobs = [], profile = null, first = null, id = 0, asked = 0, timer = null, pictures = {}, note = null;
  let answer = { numbers: {}, dots: [] }, pinned = null;

  const heading = element("h1", { textContent: "stochvi explore" });
  const sentence = element("p", { className: "answer" });
  sentence.setAttribute("role", "status");
  const facts = element("ul", { className: "facts" });
  const state = element("p", { className: "state", textContent: "compiling what the first turn needs" });
  const panel = element("form", { className: "knobs" });
  panel.addEventListener("submit", (event) => event.preventDefault());
  panel.setAttribute("aria-label", "knobs");
  const chosen = element("div", { className: "choices" });
  const tip = element("p", { className: "state" });
  tip.setAttribute("role", "status");
  const shown = element("div", { className: "pictures" });
  const [results, numbers] = tableOf("Numbers, with 95 % intervals", ["quantity", "value", "method"], "numbers");
  const [comparison, differences] = tableOf("Pinned design, and the one of the knobs", ["quantity", "pinned", "now", "change"], "differences");
  const pin = button("Pin this design", () => hold({ setting: settingNow(), answer }));
  const unpin = button("Unpin", () => hold(null));
  const goBack = button("Turn back to it", () => { adopt(pinned.setting); turn(); });
  const reset = button("As in the scene", () => { adopt(first); turn(); });
  const buttons = element("div", { className: "buttons" }, pin, goBack, unpin, reset);

  const now = (key) => {
    const knob = knobs.find((each) => each.keys.includes(key));
    return knob && knob.now * (knob.signs?.[key] ?? 1);
  };
  const stops = () => Object.fromEntries(Object.keys(SIDES).map((side) => [side, now(stopKey(side))]));
  const valuesNow = () => Object.fromEntries(knobs.flatMap((each) => each.keys.map((key) => [key, now(key)])));
  const settingNow = () => ({ values: valuesNow(), profile, system });
  const own = () => Math.min(...Object.values(stops()).filter(Number.isFinite).map(Math.abs));

  const moving = motion({
    stops, system: () => system,
    range(side) {
      const knob = knobs.find((each) => each.keys.includes(stopKey(side)));
      const found = [knob.low, knob.high].map((each) => each * (knob.signs?.[stopKey(side)] ?? 1));
      return found.sort((a, b) => a - b);
    },
    move(side, place) {
      const knob = knobs.find((each) => each.keys.includes(stopKey(side)));
      knob.now = place * (knob.signs?.[stopKey(side)] ?? 1);
      knob.show();
      moving.layout();
      turned();
    },
  });
  el.classList.add("stochvi-explore");
  el.replaceChildren(
    element("header", {}, heading, sentence, facts, state),
    element("main", {}, element("section", { className: "side" }, chosen, panel, tip, buttons), element("section", { className: "shown" }, moving.box, shown, comparison, results)),
  );

  // ----- a turn: what it asks, and what is pale until it is answered

  function turn() {
    id += 1;
    asked = performance.now();
    answer = { numbers: {}, dots: [], kept: { ...answer.kept, ...answer.numbers } };
    state.textContent = "asking";
    for (const each of [el, ...el.querySelectorAll("figure, table.numbers")]) each.classList.add("stale");
    moving.show(null);
    remember("setting", settingNow());
    model.send({ type: "turn", id, tab, values: valuesNow(), profile });
  }
  const turned = () => {
    clearTimeout(timer);
    timer = setTimeout(turn, 0); // one turn for the two stops that move together
  };
  function remember(key, value) {
    model.set(key, value);
    model.save_changes();
  }
  function adopt(setting) {
    for (const knob of knobs) {
      const [key] = knob.keys, value = setting.values?.[key];
      if (Number.isFinite(value)) knob.now = Math.min(Math.max(value * (knob.signs?.[key] ?? 1), knob.low), knob.high);
    }
    profile = setting.profile ?? profile;
    system = SYSTEMS[setting.system] ? setting.system : system;
    lay();
  }
  function hold(design) {
    pinned = design;
    remember("pinned", pinned);
    paint();
  }

  // ----- what is shown

  // choices and knobs, after a change of units or of the setting
  function lay() {
    const units = choice("units", "units", Object.keys(SYSTEMS), system);
    units[1].addEventListener("change", () => { system = units[1].value; remember("setting", settingNow()); lay(); });
    chosen.replaceChildren(...units);
    if (note.profiles.length) {
      const profiles = choice("profile", "profile", note.profiles, profile);
      profiles[1].addEventListener("change", () => { profile = profiles[1].value; turned(); });
      chosen.append(...profiles);
    }
    panel.replaceChildren(...knobs.map((each) => knobRow(each, () => system, turned, (words) => { tip.textContent = words; })));
    begin();
  }

  // pictures anew, with the colours and units of the moment
  function begin() {
    const colour = (name) => getComputedStyle(el).getPropertyValue(`--${name}`).trim();
    const colours = Object.fromEntries(["ink", "soft", "line", "closure", "simulated", "answer", "three"].map((name) => [name, colour(name)]));
    const clearance = { words: "clearance", unit: "m" };
    const made = {
      risk: picture({
        title: "Probability of any impact in the mission", colours, x: clearance, y: { words: "probability", unit: "", log: true },
        method: "Counted from first crossings of the motion without stops; the band is their 95 % interval.",
      }),
      rate: picture({
        title: "Impacts per second", colours, x: clearance, y: { words: "impacts", unit: "1/s", log: true },
        method: "Dots are simulated with the stops, with 95 % intervals. Rice leaves the stops out; the closure is an approximation.",
      }),
    };
    pictures = Object.fromEntries(Object.entries(made).map(([name, each]) => [name, { ...each, colours }]));
    shown.replaceChildren(...Object.values(pictures).map((each) => each.box));
    paint();
  }

  function marksOf(colours) {
    const marks = [{ x: own(), colour: colours.ink, kind: "solid", name: "your stops" }];
    if (answer.three) marks.push({ x: answer.three, colour: colours.three, kind: "dashed", name: "three sigma" });
    if (answer.required) marks.push({ x: answer.required, colour: colours.answer, kind: "solid", name: "required" });
    return marks.filter((each) => Number.isFinite(each.x));
  }

  const PAINTERS = {
    risk({ colours }) {
      if (!answer.curve) return null;
      const curves = [{ name: "first crossings", kind: "solid", colour: colours.simulated, x: answer.curve.clearance, y: answer.curve.probability, low: answer.curve.probability_low, high: answer.curve.probability_high }];
      if (answer.usual) curves.push({ name: "Rice", kind: "dashed", colour: colours.ink, x: answer.clearances, y: answer.usual });
      const ghost = pinned?.answer.curve;
      if (ghost) curves.push({ name: "pinned", kind: "ghost", colour: colours.soft, x: ghost.clearance, y: ghost.probability });
      const shownOf = (each) => ({ ...each, ...Object.fromEntries(["y", "low", "high"].filter((name) => each[name]).map((name) => [name, each[name].map((value) => (value > 1e-9 ? value : null))])) });
      return { curves: curves.map(shownOf), marks: marksOf(colours), levels: [{ name: "accepted", kind: "dotted", colour: colours.answer, y: now("probability") }] };
    },
    rate({ colours }) {
      if (!answer.rice) return null;
      const seen = (list) => list.map((value) => (value > 1e-5 ? value : null));
      const curves = [{ name: "Rice", kind: "dashed", colour: colours.ink, x: answer.clearances, y: seen(answer.rice) }];
      const closed = answer.dots.filter((each) => each.closure);
      if (closed.length > 1) {
        const band = (end) => closed.map((each) => each.closure[end] ?? each.closure.value);
        curves.push({ name: "closure", kind: "solid", colour: colours.closure, x: closed.map((each) => each.clearance), y: band("value"), low: band("low"), high: band("high") });
      }
      const ghost = pinned?.answer;
      if (ghost?.rice) curves.push({ name: "pinned, Rice", kind: "ghost", colour: colours.soft, x: ghost.clearances, y: seen(ghost.rice) });
      const point = (x, each, large) => ({ x, y: each.value, low: each.low, high: each.high, large });
      const points = answer.dots.map((each) => point(each.clearance, each.simulated));
      const rate = answer.numbers["simulated impact rate"];
      if (rate) points.push(point(own(), rate, true));
      const dots = [{ name: "simulated", colour: colours.simulated, points }];
      if (ghost?.numbers["simulated impact rate"]) dots.push({ name: "pinned, simulated", colour: colours.soft, points: [point(ghost.own, ghost.numbers["simulated impact rate"])] });
      return { curves, dots, marks: marksOf(colours) };
    },
  };

  function paint() {
    for (const [name, each] of Object.entries(pictures)) {
      const found = PAINTERS[name](each);
      if (found) each.set(found, system);
    }
    sentence.textContent = inUnits(answer.sentence ?? sentence.textContent, system);
    if (answer.lines) facts.replaceChildren(...answer.lines.map((each) => element("li", { textContent: inUnits(each, system) })));
    moving.mark([
      ...(answer.three ? [{ at: answer.three, name: "three sigma", kind: "three" }] : []),
      ...(answer.required ? [{ at: answer.required, name: "required", kind: "required" }] : []),
    ]);
    const all = { ...answer.kept, ...answer.numbers };
    numbers.replaceChildren(...Object.values(all).map((each) => row(each.name, withInterval(each, system), each.method)));
    compare();
  }

  function compare() {
    for (const each of [goBack, unpin]) each.hidden = !pinned;
    comparison.hidden = !pinned;
    if (!pinned) return;
    const rows = [];
    if (pinned.setting.profile !== profile) rows.push(row("profile", pinned.setting.profile, profile, "another"));
    for (const knob of knobs) {
      const [key] = knob.keys, before = pinned.setting.values[key] * (knob.signs?.[key] ?? 1);
      if (Number.isFinite(before) && before !== knob.now) rows.push(row(knob.words, spoken(before, knob.unit, system), spoken(knob.now, knob.unit, system), knob.unit === "dB" ? `${digits(knob.now - before)} dB` : change(before, knob.now)));
    }
    for (const [name, before] of Object.entries(pinned.answer.numbers)) {
      const found = answer.numbers[name];
      rows.push(row(name, withInterval(before, system), found ? withInterval(found, system) : "", found ? change(before.value, found.value) : ""));
    }
    differences.replaceChildren(...rows);
  }

  const fit = () => { moving.layout(); Object.values(pictures).forEach((each) => each.fit()); };

  // ----- what is heard

  const TAKEN = {
    linear: (message) => ({ three: message.three_sigma, clearances: message.clearances, rice: message.rice, usual: message.rice_probability, own: own() }),
    risk: (message) => ({ curve: message.curve, required: message.numbers[0].value, sentence: message.sentence, lines: message.lines }),
  };
  const FRESH = { linear: () => pictures.rate.box, risk: () => pictures.risk.box, motion: () => moving.box, rate: () => results };

  const heard = {
    knobs(message) {
      note = message;
      const written = message.knobs.map((each) => ({ ...each, keys: [each.key], unit: each.key === "probability" ? "%" : each.unit }));
      knobs = oneClearance(written).map((each) => ({ ...each, now: each.value }));
      profile = message.profile;
      heading.textContent = message.title || "stochvi explore";
      first = settingNow();
      pinned = model.get("pinned") ?? null;
      adopt(model.get("setting") ?? {});
      turn();
    },
    answer(message) {
      if (message.id !== id) return;
      if (message.missing) {
        answer.missing = message.missing;
        state.textContent = message.missing;
        if (message.part === "risk") silence();
        return;
      }
      for (const each of message.numbers ?? []) if (each) answer.numbers[each.name] = each;
      Object.assign(answer, TAKEN[message.part]?.(message));
      if (message.part === "motion") moving.show(message.path);
      if (message.part === "dot") answer.dots.push(message);
      if (message.part === "risk") el.classList.remove("stale");
      FRESH[message.part]?.().classList.remove("stale");
      state.textContent = `${STAGES[message.stage]}, ${Math.round(performance.now() - asked)} ms after the turn`;
      paint();
      if (pinned?.answer === answer) remember("pinned", pinned); // it was pinned before all was known
      el.dispatchEvent(new CustomEvent("painted", { detail: { ...message, milliseconds: performance.now() - asked } }));
    },
    done(message) {
      if (message.id !== id) return;
      answer.kept = {};
      paint();
      state.textContent = answer.missing ?? `all known, ${digits((performance.now() - asked) / 1e3)} s after the turn`;
    },
    refused(message) {
      if (message.id !== undefined && message.id !== id) return;
      state.textContent = message.sentence;
      silence(); // what the turn before said does not hold here
    },
    ended() {
      state.textContent = "stochvi explore has ended; start it anew";
    },
  };
  function silence() {
    sentence.textContent = "";
    facts.replaceChildren();
  }

  model.on("msg:custom", (message) => heard[message.type]?.(message));
  model.on("change:setting", () => {
    const setting = model.get("setting");
    if (!setting || JSON.stringify(setting) === JSON.stringify(settingNow())) return; // its own
    adopt(setting);
    turn();
  });
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", begin);
  const sized = new ResizeObserver(fit);
  sized.observe(el);
  model.send({ type: "open" });
  return () => {
    moving.end();
    sized.disconnect();
    dark.removeEventListener("change", begin);
  };
}

export default { render };
