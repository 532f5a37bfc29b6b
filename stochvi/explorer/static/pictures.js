// Pictures of curves, dots with their intervals, and marked places, over one axis.
import { SYSTEMS, digits, drawn, element, nearest, unitOf } from "./figures.js";

const HEIGHT = 270;
const DASHES = { solid: [], dashed: [8, 5], dotted: [2, 4], ghost: [10, 4, 2, 4] };

const power = (value) => (value >= 0.01 && value < 1e4 ? digits(value) : `1e${Math.round(Math.log10(value))}`);

// places of the grid of a logarithmic axis: whole decades, at most about eight of them
function decades(u, axis, low, high) {
  const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9);
  const step = Math.max(Math.ceil((last - first + 1) / 8), 1);
  const places = [];
  for (let each = first; each <= last; each += step) places.push(10 ** each);
  return places.length > 1 ? places : [low, Math.sqrt(low * high), high];
}

// rows over different places, as one table with gaps
function table(curves) {
  const places = [...new Set(curves.flatMap((each) => each.x))].sort((a, b) => a - b);
  const index = new Map(places.map((place, i) => [place, i]));
  const row = ({ x }, values) => {
    const filled = new Array(places.length).fill(null);
    x.forEach((place, i) => { filled[index.get(place)] = values[i]; });
    return filled;
  };
  return [places, curves.flatMap((each) => [each.y, each.low, each.high].filter(Boolean).map((values) => row(each, values)))];
}

function swatch({ kind, colour }) {
  const common = { stroke: colour, fill: colour };
  const inside = {
    dots: [drawn("line", { ...common, x1: 14, x2: 14, y1: 1, y2: 15 }), drawn("circle", { ...common, cx: 14, cy: 8, r: 4 })],
    band: [drawn("rect", { fill: colour, "fill-opacity": 0.25, x: 0, y: 2, width: 28, height: 12 })],
  }[kind] ?? [drawn("line", { ...common, "stroke-width": 2.5, "stroke-dasharray": DASHES[kind].join(" "), x1: 0, x2: 28, y1: 8, y2: 8 })];
  return drawn("svg", { width: 28, height: 16, "aria-hidden": "true" }, ...inside);
}

// A picture. `x` and `y` are {words, unit, log}; `set` takes what is drawn:
//   curves [{name, kind, colour, x, y, low, high}] in SI units (low and high make a band),
//   dots   [{name, colour, points: [{x, y, low, high}]}],
//   marks  [{name, colour, kind, x}] vertical, and levels [{name, colour, kind, y}] horizontal.
export function picture({ title, method, x, y, colours }) {
  const plot = element("div", { className: "plot", role: "img", ariaLabel: `${title}; its numbers are in the tables` });
  const legend = element("ul", { className: "legend" });
  const read = element("p", { className: "read" });
  const caption = element("figcaption", {}, element("strong", { textContent: title }), element("span", { textContent: method }));
  const box = element("figure", {}, caption, plot, legend, read);
  let chart = null, shown = null, lines = [], system = null, scales = [1, 1];

  function stroke(u, { colour, kind }, from, to, name, above = 0) {
    const { ctx } = u, ratio = devicePixelRatio;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.setLineDash(DASHES[kind].map((each) => each * ratio));
    ctx.lineWidth = 2 * ratio;
    ctx.beginPath();
    ctx.moveTo(...from);
    ctx.lineTo(...to);
    ctx.stroke();
    if (name) {
      const aside = to[0] < u.bbox.left + 16 * ratio ? 17 : -3; // not over the numbers of the axis
      ctx.translate(to[0] + aside * ratio, to[1] - 6 * ratio - above);
      ctx.rotate(-Math.PI / 2);
      ctx.font = `${12 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = "bottom";
      ctx.textAlign = "left";
      ctx.fillText(name, 0, 0);
    }
    ctx.restore();
  }

  function draw(u) {
    const { left, top, width, height } = u.bbox, ratio = devicePixelRatio;
    const px = (value) => u.valToPos(value * scales[0], "x", true), py = (value) => u.valToPos(value * scales[1], "y", true);
    for (const level of shown.levels ?? []) stroke(u, level, [left, py(level.y)], [left + width, py(level.y)]);
    const named = []; // of two names that would stand in each other one stands above
    for (const mark of shown.marks ?? []) {
      const at = px(mark.x), above = named.filter((each) => Math.abs(each - at) < 16 * ratio).length;
      if (!(at > left - 1 && at <= left + width)) continue;
      stroke(u, mark, [at, top], [at, top + height], mark.name, above * 80 * ratio);
      named.push(at);
    }
    for (const { colour, points } of shown.dots ?? []) {
      for (const each of points) {
        if (!(each.y > 0 || !y.log)) continue;
        const at = px(each.x), bottom = top + height;
        const low = each.low > 0 || !y.log ? py(each.low) : bottom;
        if (each.high !== undefined) stroke(u, { colour, kind: "solid" }, [at, Math.min(low, bottom)], [at, py(each.high)]);
        u.ctx.fillStyle = colour;
        u.ctx.beginPath();
        u.ctx.arc(at, py(each.y), (each.large ? 6 : 4) * ratio, 0, 2 * Math.PI);
        u.ctx.fill();
      }
    }
  }

  // ends of an axis that show all, the dots with their intervals too
  function ends(values, log, fromZero) {
    const known = values.filter((each) => Number.isFinite(each) && (each > 0 || !log));
    if (!known.length) return [0.1, 1];
    let low = Math.min(...known), high = Math.max(...known);
    if (log) return low === high ? [low / 2, high * 2] : [low, high * 1.3];
    if (fromZero) low = Math.min(low, 0);
    return [low, high + 0.03 * (high - low || 1)];
  }

  function all(name) {
    const list = shown.curves.flatMap((each) => [...each[name], ...(name === "y" ? each.high ?? [] : [])]);
    for (const { points } of shown.dots ?? []) for (const each of points) list.push(each[name], ...(name === "y" ? [each.low, each.high] : []));
    if (name === "x") list.push(...(shown.marks ?? []).map((each) => each.x).filter((each) => each < 1.5 * Math.max(...list)));
    if (name === "y" && !y.log) list.push(...(shown.levels ?? []).map((each) => each.y));
    return list.map((each) => each * scales[name === "x" ? 0 : 1]);
  }

  function options() {
    const axis = {
      stroke: colours.ink, grid: { stroke: colours.line, width: 1 }, ticks: { stroke: colours.line },
      font: "12px system-ui, sans-serif", labelFont: "13px system-ui, sans-serif",
    };
    const logs = { splits: decades, filter: (_, places) => places, values: (_, places) => places.map(power) };
    const label = ({ words, unit }) => [words, SYSTEMS[system][unit]?.[1] ?? unit].filter(Boolean).join(", ");
    const bands = [], series = [{}];
    for (const each of shown.curves) {
      const dash = DASHES[each.kind].map((length) => length * devicePixelRatio);
      series.push({ stroke: each.colour, width: each.kind === "ghost" ? 1.5 : 2.5, dash, spanGaps: true, points: { show: false } });
      if (!each.low) continue;
      bands.push({ series: [series.length + 1, series.length], fill: `${each.colour}40` });
      for (let i = 0; i < 2; i += 1) series.push({ stroke: `${each.colour}70`, width: 1, spanGaps: true, points: { show: false } });
    }
    return {
      width: size(), height: HEIGHT, legend: { show: false }, series, bands,
      cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
      scales: {
        x: { time: false, distr: x.log ? 3 : 1, range: () => ends(all("x"), x.log) },
        y: { distr: y.log ? 3 : 1, range: () => ends(all("y"), y.log, true) },
      },
      axes: [
        { ...axis, ...(x.log && logs), label: label(x), labelSize: 22, size: 32 },
        { ...axis, ...(y.log && logs), label: label(y), labelSize: 22, size: 58 },
      ],
      hooks: { draw: [draw], setCursor: [tell] },
    };
  }

  const size = () => Math.max(plot.clientWidth, 240);

  // the values of the curves under the pointer
  function tell(u) {
    const i = u.cursor.idx;
    if (i === null || i === undefined) return;
    const place = u.data[0][i] / scales[0];
    const [factor, unit] = unitOf(x.unit, system, place);
    const values = shown.curves.filter((each) => each.kind !== "ghost").map((each) => `${each.name} ${digits(each.y[nearest(each.x, place)] ?? 0)}`);
    read.textContent = `at ${digits(place * factor)} ${unit}: ${values.join("; ")}`;
  }

  return {
    box,
    set(found, units) {
      shown = found;
      system = units;
      scales = [x, y].map(({ unit }) => SYSTEMS[system][unit]?.[0] ?? 1);
      const drawable = shown.curves.map((each) => {
        // an interval that reaches 0 goes to the lower end of a logarithmic axis
        const scaled = (row, least = null) => row?.map((value) => (value === null || (y.log && !(value > 0)) ? least : value * scales[1]));
        const [low, high] = [scaled(each.low, 1e-30), scaled(each.high)];
        return { ...each, x: each.x.map((value) => value * scales[0]), y: scaled(each.y), low, high };
      });
      const [places, rows] = table(drawable);
      const kinds = JSON.stringify([system, shown.curves.map((each) => [each.name, each.colour, !!each.low])]);
      if (!chart || kinds !== lines) {
        chart?.destroy();
        plot.replaceChildren();
        chart = new uPlot(options(), [places, ...rows], plot);
        lines = kinds;
      } else chart.setData([places, ...rows]);
      const dots = (shown.dots ?? []).map((each) => ({ ...each, kind: "dots" }));
      const named = [...shown.curves, ...dots, ...(shown.levels ?? []), ...(shown.marks ?? [])];
      legend.replaceChildren(...named.map((each) => element("li", {}, swatch(each), each.name)));
    },
    fit() { chart?.setSize({ width: size(), height: HEIGHT }); },
  };
}
