// The panel: what a design does, its knobs and pictures. It shows what it is sent, and asks by
// messages alone, so that a notebook's model and the page's (`page.js`) serve it alike. The model
// keeps two things: the `setting` of the knobs, and the `pinned` design.
import { box } from "./box.js";
import { SYSTEMS, change, digits, element, inUnits, nearest, spoken, unitOf, withInterval } from "./figures.js";
import { motion } from "./motion.js";
import { picture } from "./pictures.js";

const STAGES = { closed: "closed forms", simulated: "simulated", refined: "refined" };
const SIDES = { lower: -1, upper: 1 };
const NUMBERS = "Numbers, with 95 % intervals";
const DOUBTED = "Numbers for Gaussian noise, which the record is not, with 95 % intervals";
const FILES = { scene: "Scene file", command: "Command line", python: "Python lines", csv: "CSV", report: "Report", html: "Page without Python" };
const BARE = { "g²/Hz": "Hz,g2/Hz", "(m/s²)²/Hz": "Hz,(m/s2)2/Hz" };
const SHOWN = ["application/toml", "text/plain", "text/x-python"]; // texts to copy; others are saved at once
const stopKey = (side) => `impact_pair.0.${side}`;

// a value of a knob between its ends, and among those that are stored
const within = ({ stored, low, high }, value) => (stored ? stored[nearest(stored, value)] : Math.min(Math.max(value, low), high));

// stops of a pair that are as far away on both sides are turned together
function withClearances(knobs) {
  const of = (key) => knobs.find((each) => each.key === key);
  return knobs.flatMap((knob) => {
    const [, pair, side] = knob.key.match(/^impact_pair\.(\d+)\.(lower|upper)$/) ?? [];
    const lower = of(`impact_pair.${pair}.lower`), upper = of(`impact_pair.${pair}.upper`);
    if (!lower || !upper || lower.value !== -upper.value) return [knob];
    if (side === "lower") return [];
    const key = pair === "0" ? "clearance" : `clearance.${pair}`;
    return [{ ...upper, key, words: "clearance per side", keys: [lower.key, upper.key], signs: { [lower.key]: -1 } }];
  });
}

// knobs of the same words say of what they are
function toldApart(knobs) {
  const shared = (each) => knobs.some((other) => other !== each && other.words === each.words);
  return knobs.map((each) => (shared(each) ? { ...each, words: `${each.words} of ${each.part}` } : each));
}

// a knob: a slider whose ends are those of the server, and its number, which can be typed. Where
// answers are stored it stands at their values alone
function knobRow(knob, system, turned, tell) {
  const { stored } = knob;
  const place = (value) => (stored ? nearest(stored, value) : knob.logarithmic ? Math.log(value) : value);
  const back = (at) => (stored ? stored[at] : knob.logarithmic ? Math.exp(at) : at);
  const steps = stored ? stored.length - 1 : 1000, disabled = !steps;
  const range = element("input", { type: "range", min: 0, max: steps, step: 1, id: knob.key, disabled });
  const typed = element("input", { type: "number", step: "any", disabled });
  const label = element("label", { htmlFor: knob.key });
  const width = place(knob.high) - place(knob.low) || 1;
  const show = () => {
    const [factor, unit] = unitOf(knob.unit, system(), knob.now);
    label.textContent = unit ? `${knob.words}, ${unit}` : knob.words;
    typed.setAttribute("aria-label", `${label.textContent}, typed`);
    range.value = Math.round((steps * (place(knob.now) - place(knob.low))) / width);
    range.setAttribute("aria-valuetext", spoken(knob.now, knob.unit, system()));
    const number = Number((knob.now * factor).toPrecision(4));
    typed.value = Math.abs(number) >= 1e7 ? number.toExponential() : number;
  };
  range.addEventListener("input", () => {
    knob.now = back(place(knob.low) + (width * range.value) / steps);
    show();
    turned();
  });
  typed.addEventListener("change", () => {
    const value = typed.valueAsNumber / unitOf(knob.unit, system(), knob.now)[0];
    if (Number.isFinite(value)) knob.now = within(knob, value);
    show();
    turned();
    const [low, high] = [knob.low, knob.high].map((each) => spoken(each, knob.unit, system()));
    if (!stored) tell(value === knob.now ? "" : `${knob.words} goes from ${low} to ${high}`);
  });
  knob.show = show;
  show();
  return element("div", { className: "knob" }, label, range, typed);
}

function choice(id, words, options, now, chose) {
  const select = element("select", { id }, ...options.map((each) => element("option", { textContent: each, selected: each === now })));
  select.addEventListener("change", () => chose(select.value));
  return [element("label", { htmlFor: id, textContent: words }), select];
}

const button = (words, pressed) => {
  const made = element("button", { type: "button", textContent: words });
  made.addEventListener("click", pressed);
  return made;
};

// a place for a table of a PSD, pasted or dropped, with the unit of one that names none
function pasting(use) {
  const text = element("textarea", { id: "psd", rows: 6, placeholder: "5, 0.015\n40, 0.015\n500, 0.00015", spellcheck: false });
  const unit = choice("psd-unit", "unit of a table without a heading", Object.keys(BARE), "g²/Hz", () => {});
  text.addEventListener("dragover", (event) => event.preventDefault());
  text.addEventListener("drop", async (event) => {
    event.preventDefault();
    text.value = (await event.dataTransfer.files[0]?.text()) ?? event.dataTransfer.getData("text");
  });
  return element("details", { className: "paste" }, element("summary", { textContent: "Paste a PSD" }),
    element("label", { htmlFor: "psd", textContent: "a frequency in Hz and a density in each row; paste it, or drop a file" }), text, ...unit,
    button("Use this PSD", () => use(/^[^\d#]*[a-z]/i.test(text.value) ? text.value : `${BARE[unit[1].value]}\n${text.value}`)));
}

function tableOf(caption, heads, className) {
  const body = element("tbody");
  const head = element("tr", {}, ...heads.map((each) => element("th", { scope: "col", textContent: each })));
  return [element("table", { className }, element("caption", { textContent: caption }), element("thead", {}, head), body), body];
}

function row(name, ...cells) {
  const head = element("th", { scope: "row", textContent: name });
  return element("tr", {}, head, ...cells.map((each) => element("td", { textContent: each })));
}

const line = (name, kind, colour, x, y, band = {}) => ({ name, kind, colour, x, y, ...band });

export function render({ model, el }) {
  const tab = Math.random().toString(36).slice(2);
  let system = "mm, g", knobs = [], choices = {}, wanted = {}, note = null, pictures = {};
  let count = 0, id = 0, asked = 0, timer = null, confirming = null, taking = null, offered = null;
  let answer = { numbers: {}, dots: [], stiffness: [] }, pinned = null;

  const heading = element("h1", { textContent: "stochvi explore" });
  const sentence = element("p", { className: "answer", role: "status" });
  const facts = element("ul", { className: "facts" });
  const state = element("p", { className: "state", textContent: "compiling what the first turn needs" });
  const panel = element("form", { className: "knobs", ariaLabel: "knobs" });
  panel.addEventListener("submit", (event) => event.preventDefault());
  const chosen = element("div", { className: "choices" });
  const tip = element("p", { className: "state", role: "status" });
  const shown = element("div", { className: "pictures" });
  const [results, numbers] = tableOf(NUMBERS, ["quantity", "value", "method"], "numbers");
  const [comparison, differences] = tableOf("Pinned design, and the one of the knobs", ["quantity", "pinned", "now", "change"], "differences");
  const pin = button("Pin this design", () => hold({ setting: settingNow(), answer }));
  const unpin = button("Unpin", () => hold(null));
  const goBack = button("Turn back to it", () => open(pinned.setting));
  const reset = button("As in the scene", () => open({ preset: choices.preset, system }));
  const confirm = button("Confirm by simulation", confirmPinned);
  const cancel = button("Cancel", () => model.send({ type: "cancel", id: confirming, tab }));
  const share = element("progress", { max: 1, value: 0, ariaLabel: "progress of the confirmation" });
  const about = element("p", { className: "state", role: "status" });
  const held = element("div", { className: "buttons" }, goBack, unpin, confirm, cancel, share);
  const buttons = element("div", { className: "buttons" }, pin, reset);
  const taken = element("div", { className: "taken" });
  const away = element("section", { className: "away" },
    element("h2", { textContent: "Take away" }), element("div", { className: "buttons" }), taken);
  const paste = pasting((text) => open({ ...settingNow(), profile: null, psd: text }));

  const now = (key) => {
    const knob = knobs.find((each) => each.keys.includes(key));
    return knob && knob.now * (knob.signs?.[key] ?? 1);
  };
  const stops = () => Object.fromEntries(Object.keys(SIDES).map((side) => [side, now(stopKey(side))]));
  const valuesNow = () => Object.fromEntries(knobs.flatMap((each) => each.keys.map((key) => [key, now(key)])));
  const settingNow = () => ({ values: valuesNow(), ...choices, system });
  const rest = () => answer.rest ?? 0; // the mass hangs there, and clearances count from it
  const own = () => Math.min(...Object.values(stops()).filter(Number.isFinite).map((each) => Math.abs(each - rest())));

  const moving = motion({
    stops, system: () => system,
    range(side) {
      const knob = knobs.find((each) => each.keys.includes(stopKey(side)));
      const found = [knob.low, knob.high].map((each) => each * (knob.signs?.[stopKey(side)] ?? 1));
      return found.sort((a, b) => a - b);
    },
    move(side, place, way) {
      const knob = knobs.find((each) => each.keys.includes(stopKey(side))), sign = knob.signs?.[stopKey(side)] ?? 1;
      const next = way && knob.stored?.[knob.stored.indexOf(knob.now) + sign * Math.sign(way)];
      knob.now = next ?? within(knob, place * sign);
      knob.show();
      moving.layout();
      turned();
    },
  });
  el.classList.add("stochvi-explore");
  // else JupyterLab takes the keys of a slider for its own, and an "a" adds a cell
  el.addEventListener("focusin", ({ target }) => { target.dataset.lmSuppressShortcuts = true; });
  el.replaceChildren(
    element("header", {}, heading, sentence, facts, state),
    element("main", {}, element("section", { className: "side" }, chosen, paste, panel, tip, buttons),
      element("section", { className: "shown" }, moving.box, shown, comparison, held, about, results, away)),
  );

  // ----- a turn: what it asks, and what is pale until it is answered

  function turn() {
    id = count += 1;
    asked = performance.now();
    answer = { numbers: {}, dots: [], stiffness: [], rest: answer.rest, kept: { ...answer.kept, ...answer.numbers } };
    state.textContent = "computing";
    for (const each of [el, ...el.querySelectorAll("figure, table.numbers")]) each.classList.add("stale");
    moving.show(null);
    remember("setting", settingNow());
    if (note.designs) {
      const moving = knobs.filter((each) => each.stored.length > 1).map((each) => `${each.words} ${spoken(each.now, each.unit, system)}`);
      tip.textContent = `Shown is the stored design with ${moving.join(", ")}.`;
    }
    model.send({ type: "turn", id, tab, values: valuesNow(), ...choices });
  }
  const turned = () => {
    clearTimeout(timer);
    timer = setTimeout(turn, 0); // one turn for the two stops that move together
  };
  function remember(key, value) {
    model.set(key, value);
    model.save_changes();
  }
  // another scene, profile, table or law may have other knobs, so they are asked for
  function open(setting) {
    wanted = setting;
    const { preset = null, profile = null, law = null, psd = null } = setting;
    model.send({ type: "open", id: 0, tab, preset, profile, law, psd });
  }
  function adopt({ values = {}, system: units }) {
    for (const knob of knobs) {
      const [key] = knob.keys;
      if (Number.isFinite(values[key])) knob.now = within(knob, values[key] * (knob.signs?.[key] ?? 1));
    }
    system = SYSTEMS[units] ? units : system;
    lay();
  }
  function hold(design) {
    if (confirming !== null) model.send({ type: "cancel", id: confirming, tab });
    pinned = design;
    remember("pinned", pinned);
    paint();
  }

  // ----- what is shown

  // choices and knobs, after a change of units or of the setting
  function lay() {
    const given = "the scene given";
    const from = (change) => open({ ...settingNow(), ...change });
    const pasted = choices.psd ? ["pasted table"] : [];
    chosen.replaceChildren(
      ...(note.designs ? [] : choice("preset", "scene", [given, ...note.presets], choices.preset ?? given,
        (name) => open({ preset: name === given ? null : name, system }))),
      ...(note.profiles.length ? choice("profile", "profile", [...pasted, ...note.profiles], pasted[0] ?? choices.profile,
        (name) => from({ profile: name, psd: null })) : []),
      ...(note.laws.length > 1 ? choice("law", "stops", note.laws, choices.law, (name) => from({ law: name })) : []),
      ...choice("units", "units", Object.keys(SYSTEMS), system, (name) => { system = name; remember("setting", settingNow()); lay(); }),
    );
    paste.hidden = !note.takes_table;
    const rows = (groups) => knobs.filter((each) => groups.includes(each.group))
      .map((each) => knobRow(each, () => system, turned, (words) => { tip.textContent = words; }));
    const tolerances = rows(["tolerances"]);
    const opened = panel.querySelector("details")?.open ?? knobs.some((each) => each.group === "tolerances" && each.now > 0);
    panel.replaceChildren(...rows(["scene", "question"]));
    if (tolerances.length) panel.append(element("details", { open: opened }, element("summary", { textContent: "Tolerances" }), ...tolerances));
    moving.box.hidden = note.kind !== "pair";
    away.hidden = !note.offers.length;
    const offer = (what) => button(FILES[what] ?? what, () => (what === "html" ? offerPage() : take(what)));
    away.querySelector(".buttons").replaceChildren(...note.offers.map(offer));
    begin();
  }

  // pictures anew, with the colours and units of the moment
  function begin() {
    const colour = (name) => getComputedStyle(el).getPropertyValue(`--${name}`).trim();
    const colours = Object.fromEntries(["ink", "soft", "line", "closure", "simulated", "answer", "three", "hit"].map((name) => [name, colour(name)]));
    const clearance = { words: "clearance", unit: "m" };
    const common = { colours, x: clearance };
    const made = {
      risk: picture({
        ...common, title: "Probability of any impact in the mission", y: { words: "probability", unit: "", log: true },
        method: "Counted from first crossings of the motion without stops; the band is their 95 % interval.",
      }),
      rate: picture({
        ...common, title: "Impacts per second", y: { words: "impacts", unit: "1/s", log: true },
        method: "Dots are simulated with the stops, with 95 % intervals. Rice leaves the stops out; the closure is an approximation.",
      }),
      spectra: picture({
        colours, title: "What shakes the base, and what the mount passes on",
        x: { words: "frequency", unit: "Hz", log: true }, y: { words: "acceleration density", unit: "(m/s2)2/Hz", log: true },
        method: "Linear motion without stops, exact; impacts add to it.",
      }),
      stiffness: picture({
        colours, title: "Peak acceleration over the stiffness of the stops",
        x: { words: "stiffness", unit: "N/m", log: true }, y: { words: "peak acceleration", unit: "m/s2" },
        method: "Exceeded in the mission with the accepted probability; simulated with the stops, with 95 % intervals.",
      }),
      box: box(),
      absorbed: picture({
        colours, title: "Vibration that the absorber leaves", x: { words: "level", unit: "dB" }, y: { words: "rms with over without", unit: "" },
        method: "Simulated; the band is the 95 % interval.",
      }),
      branches: picture({
        colours, title: "Periodic motions about the frequency of the sine",
        x: { words: "frequency", unit: "Hz" }, y: { words: "largest displacement", unit: "m" },
        method: "Exact motions between impacts, followed over frequency: where a stable one ends, the motion jumps.",
      }),
    };
    pictures = Object.fromEntries(Object.entries(made).map(([name, each]) => [name, { ...each, colours }]));
    shown.replaceChildren(...Object.values(pictures).map((each) => each.box));
    paint();
  }

  function marksOf(colours) {
    const marks = [{ x: own(), colour: colours.ink, kind: "solid", name: rest() ? "your nearer stop" : "your stops" }];
    if (answer.three) marks.push({ x: answer.three, colour: colours.three, kind: "dashed", name: "three sigma" });
    if (answer.required) marks.push({ x: answer.required, colour: colours.answer, kind: "solid", name: "required" });
    return marks.filter((each) => Number.isFinite(each.x));
  }

  // the risk of one pair over its clearance; of several, a curve for each
  function curvesOf(curve) {
    const common = { kind: "solid", y: curve.probability, low: curve.probability_low, high: curve.probability_high };
    if (curve.clearance) return [{ ...common, name: "first crossings", x: curve.clearance }];
    const pairs = Object.keys(curve).filter((each) => !each.startsWith("probability") && each !== "independent");
    return pairs.map((name) => ({ ...common, name: pairs.length > 1 ? name : "first crossings", x: curve[name] }));
  }

  const PAINTERS = {
    risk({ colours }) {
      if (!answer.curve) return null;
      const own = [colours.simulated, colours.closure, colours.answer, colours.three, colours.hit];
      const curves = curvesOf(answer.curve).map((each, i) => ({ ...each, colour: own[i % own.length] }));
      if (answer.usual && curves.length === 1) curves.push(line("Rice", "dashed", colours.ink, answer.clearances, answer.usual));
      if (pinned?.answer.curve) {
        curves.push(...curvesOf(pinned.answer.curve).map(({ x, y }) => line("pinned", "ghost", colours.soft, x, y)));
      }
      const seen = (list) => list?.map((value) => (value > 1e-9 ? value : null));
      return {
        curves: curves.map((each) => ({ ...each, y: seen(each.y), low: seen(each.low), high: seen(each.high) })),
        marks: note.kind === "pair" ? marksOf(colours) : [],
        levels: [{ name: "accepted", kind: "dotted", colour: colours.answer, y: now("probability") }],
      };
    },
    rate({ colours }) {
      if (!answer.rice || note.kind !== "pair") return null;
      const seen = (list) => list.map((value) => (value > 1e-5 ? value : null));
      const curves = [line("Rice", "dashed", colours.ink, answer.clearances, seen(answer.rice))];
      const closed = answer.dots.filter((each) => each.closure);
      if (closed.length > 1) {
        const band = (end) => closed.map((each) => each.closure[end] ?? each.closure.value);
        const places = closed.map((each) => each.clearance);
        curves.push(line("closure", "solid", colours.closure, places, band("value"), { low: band("low"), high: band("high") }));
      }
      const ghost = pinned?.answer;
      if (ghost?.rice) curves.push(line("pinned, Rice", "ghost", colours.soft, ghost.clearances, seen(ghost.rice)));
      const point = (x, each, large) => ({ x, y: each.value, low: each.low, high: each.high, large });
      const points = answer.dots.map((each) => point(each.clearance, each.simulated));
      const rate = answer.numbers["simulated impact rate"];
      if (rate) points.push(point(own(), rate, true));
      const dots = [{ name: "simulated", colour: colours.simulated, points }];
      const before = ghost?.numbers["simulated impact rate"], sure = pinned?.confirmed;
      if (before) dots.push({ name: "pinned, simulated", colour: colours.soft, points: [point(ghost.own, before)] });
      if (sure) dots.push({ name: "pinned, confirmed", colour: colours.answer, points: [point(sure.clearance, sure.numbers[0], true)] });
      return { curves, dots, marks: marksOf(colours) };
    },
    spectra({ colours }) {
      const found = answer.spectra;
      if (!found?.passed_density) return null;
      const curves = [
        line("base", "dashed", colours.ink, found.frequency_hz, found.base_density),
        line("passed on", "solid", colours.simulated, found.frequency_hz, found.passed_density),
      ];
      const ghost = pinned?.answer.spectra;
      if (ghost) curves.push(line("pinned, passed on", "ghost", colours.soft, ghost.frequency_hz, ghost.passed_density));
      return { curves };
    },
    stiffness({ colours }) {
      if (!answer.stiffness.length) return null;
      return {
        curves: [], dots: [{ name: "simulated", colour: colours.simulated, points: answer.stiffness }],
        marks: [{ name: "your stops", kind: "solid", colour: colours.ink, x: now("impact_pair.0.law.stiffness") }],
      };
    },
    box: () => answer.box,
    absorbed({ colours }) {
      const found = answer.absorbed;
      const band = { low: found?.rms_ratio_low, high: found?.rms_ratio_high };
      return found && {
        curves: [line("rms ratio", "solid", colours.simulated, found.level_db, found.rms_ratio, band)],
        levels: [{ name: "without the absorber", kind: "dotted", colour: colours.ink, y: 1 }],
      };
    },
    branches({ colours }) {
      const found = answer.branches;
      if (!found) return null;
      const points = found.frequency_hz.map((x, i) => ({ x, y: found.displacement_max[i], stable: found.stable[i] > 0 && found.admissible[i] > 0 }))
        .filter((each) => each.y !== null);
      const marks = [{ name: "your sine", kind: "solid", colour: colours.ink, x: now("excitation.0.frequency_hz") }];
      return { curves: [], marks, dots: [
        { name: "stable", colour: colours.simulated, points: points.filter((each) => each.stable) },
        { name: "unstable", colour: colours.three, points: points.filter((each) => !each.stable) },
      ] };
    },
  };

  function paint() {
    for (const [name, each] of Object.entries(pictures)) {
      const found = PAINTERS[name](each);
      each.box.hidden = !found && !each.drawn;
      each.drawn ||= !!found;
      if (found) each.set(found, system);
    }
    sentence.textContent = inUnits(answer.sentence ?? sentence.textContent, system);
    if (answer.lines) facts.replaceChildren(...answer.lines.map((each) => element("li", { textContent: inUnits(each, system) })));
    moving.mark([
      ...(answer.three ? [{ at: answer.three, name: "three sigma", kind: "three" }] : []),
      ...(answer.required ? [{ at: answer.required, name: "required", kind: "required" }] : []),
    ], rest());
    el.classList.toggle("doubted", !!answer.doubted);
    results.querySelector("caption").textContent = answer.doubted ? DOUBTED : NUMBERS;
    const all = { ...answer.kept, ...answer.numbers };
    results.hidden = !Object.keys(all).length;
    numbers.replaceChildren(...Object.values(all).map((each) => row(each.name, withInterval(each, system), each.method)));
    compare();
  }

  function compare() {
    comparison.hidden = held.hidden = !pinned;
    cancel.hidden = share.hidden = confirming === null;
    confirm.hidden = confirming !== null || note.designs > 0;
    confirm.disabled = !["pair", "box"].includes(note.kind);
    if (!pinned) return;
    const rows = [];
    const choicesOf = { preset: "scene", profile: "profile", psd: "table", law: "stops" };
    for (const [key, words] of Object.entries(choicesOf)) {
      const said = ({ [key]: value }) => (key === "psd" && value ? "pasted" : value ?? { profile: "none", psd: "none" }[key] ?? "as given");
      if (said(pinned.setting) !== said(choices)) rows.push(row(words, said(pinned.setting), said(choices), "another"));
    }
    for (const knob of knobs) {
      const [key] = knob.keys, before = pinned.setting.values[key] * (knob.signs?.[key] ?? 1);
      if (!Number.isFinite(before) || before === knob.now) continue;
      const said = (value) => spoken(value, knob.unit, system);
      const changed = knob.unit === "dB" || !before ? said(knob.now - before) : change(before, knob.now);
      rows.push(row(knob.words, said(before), said(knob.now), changed));
    }
    for (const [name, before] of Object.entries(pinned.answer.numbers)) {
      const found = answer.numbers[name];
      rows.push(row(name, withInterval(before, system), found ? withInterval(found, system) : "", found ? change(before.value, found.value) : ""));
    }
    for (const each of pinned.confirmed?.numbers ?? []) rows.push(row(`${each.name}, confirmed`, withInterval(each, system), "", ""));
    differences.replaceChildren(...rows);
  }

  // ----- the pinned design confirmed, and what is taken away

  function confirmPinned() {
    confirming = count += 1;
    share.value = 0;
    about.textContent = "";
    paint();
    const { system: _, ...setting } = pinned.setting;
    model.send({ type: "confirm", id: confirming, tab, ...setting });
  }
  function confirmed(words) {
    confirming = null;
    about.textContent = words;
    paint();
  }
  const said = (words) => taken.replaceChildren(element("p", { className: "state", textContent: words }));
  function take(what) {
    offered = null;
    taking = count += 1;
    said("making it");
    model.send({ type: "take", id: taking, tab, what, values: valuesNow(), ...choices });
  }
  // a page that needs no Python: which knobs move in it, what that costs, and its making
  function offerPage() {
    const told = element("p", { className: "state", role: "status" });
    const share = element("progress", { max: 1, value: 0, hidden: true, ariaLabel: "progress of the file" });
    const usual = knobs.filter((each) => /clearance$|frequency_hz$|level_db$/.test(each.key)).slice(0, 3);
    const marks = knobs.map((knob) => {
      const mark = element("input", { type: "checkbox", checked: usual.length ? usual.includes(knob) : knob === knobs[0] });
      mark.addEventListener("change", price);
      return element("label", {}, mark, ` ${knob.words}`);
    });
    const [label, steps] = choice("steps", "values of each", ["3", "5", "7", "9"], "5", price);
    const make = button("Make the file", () => {
      ask("page");
      share.hidden = stop.hidden = false;
      make.disabled = true;
    });
    const stop = element("button", { type: "button", textContent: "Stop", hidden: true });
    stop.addEventListener("click", () => { model.send({ type: "cancel", id: taking, tab }); price(); });
    function ask(type) {
      const moved = knobs.filter((_, i) => marks[i].firstChild.checked).map((each) => each.keys);
      taking = count += 1;
      model.send({ type, id: taking, tab, what: { knobs: moved, steps: Number(steps.value) }, values: valuesNow(), ...choices });
    }
    function price() {
      told.textContent = "trying three designs for its time and size";
      share.hidden = stop.hidden = make.disabled = true;
      ask("price");
    }
    taken.replaceChildren(element("fieldset", {}, element("legend", { textContent: "Knobs that move in the file, three at most" }), ...marks),
      element("div", { className: "buttons" }, label, steps, make, stop, share), told);
    offered = {
      say(words, ready) { told.textContent = words; make.disabled = !ready; },
      at({ done, words }) { share.value = done; told.textContent = words; },
    };
    price();
  }
  function save({ name, media, text }) {
    const address = URL.createObjectURL(new Blob([text], { type: media }));
    element("a", { href: address, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  }

  const fit = () => { moving.layout(); Object.values(pictures).forEach((each) => each.fit()); };

  // ----- what is heard

  const TAKEN = {
    spectra: (message) => ({ spectra: message }),
    absorbed: (message) => ({ absorbed: message.table, sentence: message.sentence }),
    branches: (message) => ({ branches: message.table, sentence: message.sentence }),
    linear: ({ three_sigma: three, clearances, rice, rice_probability: usual, rest: hangs }) => {
      answer.rest = hangs;
      return { three, clearances, rice, usual, own: own() };
    },
    risk: ({ curve, shared, numbers: found, sentence: said, lines, doubted, box: drawing }) => (
      { curve: curve ?? shared, required: doubted ? null : found.at(-1).value, sentence: said, lines, doubted, box: drawing }),
  };
  // what is no longer pale once a part is there
  const FRESH = { linear: () => pictures.rate.box, rate: () => results, motion: () => moving.box };
  for (const name of ["risk", "spectra", "absorbed", "branches", "stiffness"]) FRESH[name] = () => pictures[name].box;

  const heard = {
    knobs(message) {
      note = message;
      if (choices.preset !== message.preset) {
        answer = { numbers: {}, dots: [], stiffness: [] };
        silence();
      }
      choices = { preset: message.preset, profile: message.profile, law: message.law, psd: wanted.psd ?? null };
      if (choices.psd) choices.profile = null;
      const share = (each) => each.key === "probability" || (each.group === "tolerances" && !each.unit);
      const written = [...message.knobs, ...message.tolerances]
        .map((each) => ({ ...each, keys: [each.key], unit: share(each) ? "%" : each.unit }));
      const before = String(knobs.map((each) => each.key));
      knobs = toldApart(withClearances(written)).map((each) => ({ ...each, now: each.value }));
      if (before !== String(knobs.map((each) => each.key))) { // what is offered is of other knobs
        taken.replaceChildren();
        offered = null;
      }
      heading.textContent = message.title || "stochvi explore";
      tip.textContent = "";
      adopt(wanted);
      turn();
    },
    progress(message) {
      if (message.id === taking) offered?.at(message);
      if (message.id !== confirming) return;
      share.value = message.done;
      about.textContent = message.words;
    },
    priced({ id: of, designs, seconds, bytes }) {
      const cost = `${designs} designs: up to ${spoken(seconds, "s", system, 2)} of computing, ${digits(bytes / 2 ** 20, 2)} MB`;
      if (of === taking) offered?.say(cost, true);
    },
    file(message) {
      if (message.id !== taking) return;
      offered = null;
      if (!SHOWN.includes(message.media)) {
        said(`${message.name} is saved, ${Math.ceil(message.text.length / 1024)} kB`);
        save(message);
        return;
      }
      const copy = button("Copy", async () => { await navigator.clipboard.writeText(message.text); copy.textContent = "Copied"; });
      const text = element("pre", { textContent: message.text, tabIndex: 0, role: "region", ariaLabel: message.name });
      taken.replaceChildren(text, element("div", { className: "buttons" }, copy, button(`Save ${message.name}`, () => save(message))));
    },
    answer(message) {
      if (message.part === "confirmed" && message.id === confirming) {
        pinned.confirmed = message;
        remember("pinned", pinned);
        paint();
        return;
      }
      if (message.id !== id) return;
      if (message.short) answer.missing = message.short; // shown as far as it got, and why
      if (message.missing) {
        answer.missing = message.missing;
        state.textContent = message.missing;
        if (message.part !== "risk") return;
        silence(); // what is known is in the table and the pictures
        answer.sentence = `The required clearance is not known: ${message.missing}.`;
        paint();
        return;
      }
      for (const each of message.numbers ?? []) if (each) answer.numbers[each.name] = each;
      Object.assign(answer, TAKEN[message.part]?.(message));
      if (message.part === "motion") moving.show(message.path);
      if (message.part === "dot") answer.dots.push(message);
      if (message.part === "stiffness") {
        answer.stiffness = message.peaks.map(({ value, low, high }, i) => ({ x: message.stiffness[i], y: value, low, high }));
      }
      if (message.box) pictures.box.box.classList.remove("stale");
      if (message.part === "risk") el.classList.remove("stale");
      FRESH[message.part]?.().classList.remove("stale");
      state.textContent = `${STAGES[message.stage]}, ${digits((performance.now() - asked) / 1e3)} s after the turn`;
      if (message.next) state.textContent += `; now ${message.next}`;
      paint();
      if (pinned?.answer === answer) remember("pinned", pinned); // it was pinned before all was known
      el.dispatchEvent(new CustomEvent("painted", { detail: { ...message, milliseconds: performance.now() - asked } }));
    },
    done(message) {
      if (message.id === confirming) confirmed(pinned?.confirmed ? pinned.confirmed.short ?? "confirmed" : "cancelled");
      if (message.id !== id) return;
      answer.kept = {};
      for (const each of [el, ...el.querySelectorAll(".stale")]) each.classList.remove("stale");
      paint();
      const known = note.designs ? `computed before: this file holds ${note.designs} designs, and its knobs move from one to the next`
        : `all known, ${digits((performance.now() - asked) / 1e3)} s after the turn`;
      state.textContent = answer.missing ?? known;
    },
    refused(message) {
      if (message.id === 0 && note) { // a choice: the one before it stays
        tip.textContent = message.sentence;
        lay();
      } else if (message.id === confirming && confirming !== null) confirmed(message.sentence);
      else if (message.id === taking && taking !== null) (offered?.say ?? said)(message.sentence, false);
      else if (!message.id || message.id === id) {
        state.textContent = message.sentence;
        silence(); // what the turn before said does not hold here
      }
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
    open(setting);
  });
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", begin);
  const sized = new ResizeObserver(fit);
  sized.observe(el);
  pinned = model.get("pinned") ?? null;
  open(model.get("setting") ?? {});
  return () => {
    moving.end();
    sized.disconnect();
    dark.removeEventListener("change", begin);
  };
}
