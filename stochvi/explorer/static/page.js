// The browser's side of the protocol: what a notebook's kernel is for `explore.js`, over fetch.
// The setting of the knobs lives in the history of the tab, so that back, forward and a reload find
// it; the pinned design in the storage of the tab. Neither leaves the browser, nor has the token.
import { render } from "./explore.js";

const PAUSE = 1000; // ms after which a change of the setting is a step of the history
const token = location.hash.slice(1);
const headers = { "x-stochvi-token": token };
const hearers = {};
const running = {};
const changed = {};
let last = 0;

const tell = (event, ...what) => (hearers[event] ?? []).forEach((hear) => hear(...what));

async function lines(reply, each) {
  const reader = reply.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const parts = (rest + value).split("\n");
    rest = parts.pop();
    parts.filter(Boolean).forEach((line) => each(JSON.parse(line)));
  }
}

const model = {
  on: (event, hear) => (hearers[event] ??= []).push(hear),
  get: (key) => (key === "setting" ? history.state?.setting : JSON.parse(sessionStorage.getItem(key))),
  set: (key, value) => { changed[key] = value; },
  save_changes() {
    for (const [key, value] of Object.entries(changed)) {
      delete changed[key];
      if (key !== "setting") {
        sessionStorage.setItem(key, JSON.stringify(value));
        continue;
      }
      if (JSON.stringify(history.state?.setting) === JSON.stringify(value)) continue;
      const step = history.state?.setting && performance.now() - last > PAUSE ? "pushState" : "replaceState";
      history[step]({ setting: value }, "");
      last = performance.now();
    }
  },
  // a new message of a type ends the work on the last one
  async send(message) {
    const own = new AbortController();
    running[message.type]?.abort();
    running[message.type] = own;
    try {
      const body = JSON.stringify(message);
      const reply = await fetch("ask", { method: "POST", headers, body, signal: own.signal });
      if (!reply.ok) throw new Error(reply.status === 403 ? "open the address that stochvi explore printed" : await reply.text());
      await lines(reply, (answer) => tell("msg:custom", answer));
    } catch (error) {
      if (error.name !== "AbortError") tell("msg:custom", { type: "refused", id: message.id, sentence: `No answer: ${error.message}` });
    }
  },
};

addEventListener("popstate", () => {
  last = performance.now();
  tell("change:setting");
});
addEventListener("hashchange", () => location.reload()); // another token

// the server ends soon after its last tab, which it knows by this request
(async () => {
  try {
    const reply = await fetch("alive", { headers });
    if (!reply.ok) return; // told by the first answer
    await lines(reply, () => {});
  } catch { /* told below */ }
  tell("msg:custom", { type: "ended" });
})();

render({ model, el: document.getElementById("explore") });
