// Numbers in words: units, digits, intervals.

// factors from SI units, and the names that are shown, by system
export const SYSTEMS = {
  "mm, g": { m: [1e3, "mm"], "m/s": [1e3, "mm/s"], "m/s2": [1 / 9.80665, "g"], "(m/s2)2/Hz": [1 / 9.80665 ** 2, "g²/Hz"] },
  "mm, m/s²": { m: [1e3, "mm"], "m/s": [1e3, "mm/s"], "m/s2": [1, "m/s²"], "(m/s2)2/Hz": [1, "(m/s²)²/Hz"] },
  "in, g": { m: [1 / 0.0254, "in"], "m/s": [1 / 0.0254, "in/s"], "m/s2": [1 / 9.80665, "g"], "(m/s2)2/Hz": [1 / 9.80665 ** 2, "g²/Hz"] },
};
const TIMES = [[3600, "h"], [60, "min"], [1, "s"]];

export function digits(value, count = 3) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(count - 1);
  return count > 3 ? value.toPrecision(count) : String(Number(value.toPrecision(count)));
}

// the factor from SI units to those that are shown, and their name; a time has the largest unit
// that it fills, and a rare event is counted per hour
export function unitOf(unit, system, value) {
  if (unit === "%") return [100, "%"];
  if (unit === "1/s" && Math.abs(value) < 0.1) return [3600, "1/h"];
  if (unit === "s") {
    const [seconds, name] = TIMES.find(([each]) => value >= each * 0.9999) ?? TIMES[2];
    return [1 / seconds, name];
  }
  return SYSTEMS[system][unit] ?? [1, unit];
}

export function spoken(value, unit, system, count = 3) {
  const [factor, shown] = unitOf(unit, system, value);
  return `${digits(value * factor, count)} ${shown}`.trim();
}

// with as many digits as tell the ends of the interval apart
export function withInterval({ value, low, high, unit }, system) {
  if (low === undefined || low === high) return spoken(value, unit, system);
  const [factor, shown] = unitOf(unit, system, value);
  const count = [3, 4, 5, 6].find((n) => digits(low * factor, n) !== digits(high * factor, n)) ?? 6;
  const [middle, ...ends] = [value, low, high].map((each) => digits(each * factor, count));
  return `${middle} (${ends.join(" to ")}) ${shown}`.trim();
}

// what a number became, in per cent, or as a factor where it changed a lot
export function change(before, now) {
  if (before === now) return "same";
  const ratio = now / before;
  if (!(ratio > 0) || !Number.isFinite(ratio)) return digits(now - before);
  if (ratio > 2 || ratio < 0.5) return ratio > 1 ? `${digits(ratio)} times` : `1/${digits(1 / ratio)}`;
  return `${ratio > 1 ? "+" : "−"}${digits(100 * Math.abs(ratio - 1), 2)} %`;
}

// a sentence of the server, whose lengths are in mm
export function inUnits(sentence, system) {
  const [factor, unit] = SYSTEMS[system].m;
  if (unit === "mm") return sentence;
  return sentence.replace(/(\d[\d.e+-]*) mm\b/g, (_, length) => `${digits((length * factor) / 1e3, 4)} ${unit}`);
}

// the place in a list of the number that is nearest to a value
export const nearest = (list, value) => list.reduce((best, each, i) => (Math.abs(each - value) < Math.abs(list[best] - value) ? i : best), 0);

export function element(tag, attributes = {}, ...inside) {
  const made = Object.assign(document.createElement(tag), attributes);
  made.append(...inside);
  return made;
}

export function drawn(tag, attributes = {}, ...inside) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...inside);
  return made;
}
