// The mass between its stops: it moves along one simulated path, a stop lights up when it is hit,
// and the stops are dragged, or moved by the arrow keys.
import { drawn, element, spoken } from "./figures.js";

const SLOW = 12; // how much slower than it is the motion moves
const LIT = 250; // ms for which a stop stays lit
const HEIGHT = 150, MASS = 56, ROOM = 1.12;
const SIGNS = { lower: -1, upper: 1 };

// `stops()`: {lower, upper} in m; `range(side)`: ends of a stop in m; `move(side, place, way)` is told a drag,
// or steps of the keyboard
export function motion({ stops, range, move, system }) {
  const svg = drawn("svg", { class: "motion", role: "group", "aria-label": "The mass between its stops" });
  const pause = element("button", { type: "button" });
  const caption = element("figcaption");
  const box = element("figure", { className: "moving" }, element("div", { className: "heading" }, caption, pause), svg);
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  let path = null, time = 0, last = performance.now(), paused = still.matches, lit = {}, hits = 0, before = -1;
  let marks = [], rest = 0, parts = {}, width = 900, reach = 1, held = false, laid = "";

  const floor = HEIGHT - 40;
  const at = (x) => width / 2 + (x / reach) * (width / 2 - MASS / 2 - 40);
  const face = (side, x) => at(x) + (SIGNS[side] * MASS) / 2;

  function layout() {
    width = Math.max(svg.clientWidth, 280);
    svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    const now = stops();
    if (!held) { // a scale that moves under the hand cannot be aimed at
      const places = [...Object.values(now), ...marks.map((each) => each.at + Math.abs(rest))].filter(Number.isFinite);
      reach = ROOM * Math.max(...places.map(Math.abs), 1e-9);
    }
    const kept = document.activeElement?.dataset?.side;
    const mass = drawn("rect", { class: "mass", x: -MASS / 2, y: floor - MASS, width: MASS, height: MASS });
    svg.replaceChildren(drawn("line", { class: "floor", x1: 0, x2: width, y1: floor, y2: floor }));
    const rows = [HEIGHT - 22, HEIGHT - 6, HEIGHT - 22];
    marks.forEach(({ at: place, name, kind }, i) => [-1, 1].forEach((sign) => {
      const x = at(rest + sign * place) + (sign * MASS) / 2;
      if (sign < 0 && now.lower === undefined) return;
      svg.append(drawn("line", { class: `mark ${kind}`, x1: x, x2: x, y1: 22, y2: floor + 4 }));
      if (sign > 0) {
        const label = drawn("text", { class: kind, x: Math.min(x, width - 4), y: rows[i % 3], "text-anchor": x > width - 150 ? "end" : "middle" });
        label.append(`${name}, ${spoken(place, "m", system())}`);
        svg.append(label);
      }
    }));
    svg.append(mass);
    parts = { mass };
    for (const [side, sign] of Object.entries(SIGNS)) if (now[side] !== undefined) svg.append(stop(side, sign, now[side], mass));
    if (kept) parts[kept]?.focus();
    place();
  }

  function stop(side, sign, x) {
    const [low, high] = range(side);
    const line = drawn("rect", { class: "stop", x: sign < 0 ? -12 : 0, y: 22, width: 12, height: floor - 22 });
    const name = drawn("text", { class: "own", x: sign * 16, y: 16, "text-anchor": sign < 0 ? "start" : "end" });
    name.append(spoken(Math.abs(x), "m", system()));
    const handle = drawn("g", {
      tabindex: 0, role: "slider", "data-side": side, "aria-label": `${side} stop, dragged or moved by the arrow keys`,
      "aria-orientation": "horizontal", "aria-valuemin": low, "aria-valuemax": high, "aria-valuenow": x,
      "aria-valuetext": spoken(x, "m", system()), transform: `translate(${face(side, x)} 0)`,
    }, drawn("rect", { class: "grip", x: -18, y: 4, width: 36, height: floor }), line, name);
    const set = (to, way) => move(side, Math.min(Math.max(to, low), high), way);
    handle.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      handle.focus();
      svg.setPointerCapture(event.pointerId);
      const from = event.clientX, start = stops()[side], scale = (width / 2 - MASS / 2 - 40) * (svg.clientWidth / width);
      const drag = (to) => set(start + ((to.clientX - from) / scale) * reach);
      held = true;
      svg.addEventListener("pointermove", drag);
      svg.addEventListener("lostpointercapture", () => { svg.removeEventListener("pointermove", drag); held = false; layout(); }, { once: true });
    });
    handle.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
      if (!way) return;
      event.preventDefault();
      set(stops()[side] + (way * (high - low)) / 200, way);
    });
    parts[side] = Object.assign(handle, { line });
    return handle;
  }

  // the mass, and which stops are lit, at the time of the path
  function place() {
    let x = rest;
    if (path) {
      const step = path.time[1] - path.time[0];
      const exact = (time / step) % (path.time.length - 1), i = Math.floor(exact);
      x = path.displacement[i] + (exact - i) * (path.displacement[i + 1] - path.displacement[i]);
      if (i < before) hits = 0;
      for (let j = before + 1; j <= i; j += 1) {
        if (!path.impact_speed[j]) continue;
        lit[path.impact_speed[j] > 0 ? "upper" : "lower"] = performance.now();
        hits += 1;
      }
      before = i;
    }
    parts.mass?.setAttribute("transform", `translate(${at(x)} 0)`);
    for (const side of Object.keys(SIGNS)) parts[side]?.line.classList.toggle("lit", performance.now() - (lit[side] ?? -1e9) < LIT);
    const so = path && !paused ? `; ${hits} ${hits === 1 ? "impact" : "impacts"} in ${(time % (path.time.at(-1) - path.time[0])).toFixed(1)} s` : "";
    const words = `One simulated path, ${SLOW} times slower; a stop turns red at an impact, and is dragged${so}`;
    if (caption.textContent !== words) caption.textContent = words;
  }

  function paint() {
    pause.textContent = paused ? "Move" : "Pause";
    pause.setAttribute("aria-label", paused ? "Move the mass" : "Pause the moving mass");
  }
  pause.addEventListener("click", () => { paused = !paused; paint(); });
  paint();

  let live = true;
  (function frame(now) {
    if (!live) return;
    if (path && !paused) {
      time += (now - last) / 1e3 / SLOW;
      place();
    }
    last = now ?? last;
    requestAnimationFrame(frame);
  })();

  return {
    box, layout,
    // a path of the design that is shown; none while a new one is asked for
    show(found) { path = found; time = 0; hits = 0; before = -1; lit = {}; place(); },
    mark(found, hangs) {
      const now = JSON.stringify([found, hangs, stops(), system()]);
      if (now === laid) return; // a stop that is drawn anew slips from the hand
      [laid, marks, rest] = [now, found, hangs];
      layout();
    },
    end() { live = false; },
  };
}
