// A box with its mounts and snubbers, seen at an angle; a snubber has the colour of its risk.
import { drawn, element } from "./figures.js";

const WIDTH = 560, HEIGHT = 240, EDGE = 182;
const shares = (value) => (value > 0.9995 ? "100 %" : value < 1e-6 ? "under 1e-4 %" : `${Number((100 * value).toPrecision(2))} %`);

// places of the drawing of points [x, y, z]: x to the right, y into the depth, z upwards
const seen = ([x, y, z]) => [x + 0.45 * y, -z - 0.35 * y];
const endsOf = (points, i) => [Math.min(...points.map((each) => each[i])), Math.max(...points.map((each) => each[i]))];

export function box() {
  const label = "The box with its mounts and snubbers; the table has their numbers";
  const svg = drawn("svg", { class: "box", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label });
  const caption = element("figcaption", {}, element("strong", { textContent: "The box: mounts as squares, snubbers as discs" }),
    element("span", { textContent: "Beside a snubber: the probability that it is hit in the mission as the scene has it, "
      + "from first crossings. The fuller the colour, the likelier." }));
  const figure = element("figure", {}, caption, svg);
  return {
    box: figure,
    set({ mounts, corners }) {
      const points = [...mounts, ...corners.map((each) => each.at)];
      const ends = [0, 1, 2].map((i) => endsOf(points, i));
      if (ends[2][1] - ends[2][0] < 0.05) ends[2][1] += 0.6 * (ends[0][1] - ends[0][0]); // all in one plane: a body above it
      const solid = [0, 1].flatMap((i) => [0, 1].flatMap((j) => [0, 1].map((k) => [ends[0][i], ends[1][j], ends[2][k]])));
      const flat = [...solid, ...points].map(seen);
      const [left, right] = endsOf(flat, 0), [top, bottom] = endsOf(flat, 1);
      const scale = Math.min((WIDTH - 2 * EDGE) / (right - left), (HEIGHT - 60) / (bottom - top));
      const at = (point) => {
        const [x, y] = seen(point);
        return [WIDTH / 2 + (x - (left + right) / 2) * scale, HEIGHT / 2 + (y - (top + bottom) / 2) * scale];
      };
      const neighbours = (a, b) => a.filter((each, k) => each !== b[k]).length === 1;
      const edges = solid.flatMap((a, i) => solid.slice(i + 1).filter((b) => neighbours(a, b)).map((b) => [at(a), at(b)]));
      svg.replaceChildren(
        ...edges.map(([a, b]) => drawn("line", { class: "edge", x1: a[0], y1: a[1], x2: b[0], y2: b[1] })),
        ...mounts.map(at).map(([x, y]) => drawn("rect", { class: "mount", x: x - 6, y: y - 6, width: 12, height: 12 })),
        ...corners.flatMap((each) => {
          const [x, y] = at(each.at);
          const out = Math.abs(x - WIDTH / 2) < WIDTH / 6 ? 0 : Math.sign(x - WIDTH / 2); // words stand outside the box
          const words = drawn("text", { x: x + 14 * out, y: y + (out ? 4 : -14), "text-anchor": ["end", "middle", "start"][out + 1] });
          words.append(`${each.name}, ${shares(each.probability)}`);
          const full = Math.max(0, Math.min(1, 1 + Math.log10(Math.max(each.probability, 1e-6)) / 6));
          return [drawn("circle", { class: "snubber", cx: x, cy: y, r: 9, "fill-opacity": full.toFixed(2) }), words];
        }),
      );
    },
    fit() {},
  };
}
