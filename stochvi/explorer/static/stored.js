// The model of a file without a server: turns that were computed before answer it.
import { nearest } from "./figures.js";
import { render } from "./explore.js";

const packed = Uint8Array.from(atob(document.getElementById("stored").textContent), (each) => each.charCodeAt(0));
const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const { opened, axes, turns } = await new Response(unpacked).json();
const hearers = {}, kept = {};

// the turn of the stored design that is nearest to a setting
function turnAt(values) {
  const place = (axis) => nearest(axis.places.map((each) => each[0]), values[axis.keys[0]]);
  return turns[axes.reduce((found, axis) => found * axis.places.length + place(axis), 0)];
}

const ANSWERS = { open: () => [opened], turn: ({ id, values }) => turnAt(values).map((each) => ({ ...each, id })) };

const model = {
  on: (event, hear) => { hearers[event] = hear; },
  get: (key) => kept[key],
  set: (key, value) => { kept[key] = value; },
  save_changes() {},
  send(message) {
    const answers = ANSWERS[message.type](message);
    setTimeout(() => answers.forEach((each) => hearers["msg:custom"](each)), 0);
  },
};

render({ model, el: document.getElementById("explore") });
