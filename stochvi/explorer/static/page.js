// The browser's side of the protocol: what a notebook's kernel is for `explore.js`, over fetch.
import explore from "./explore.js";

const token = location.hash.slice(1);
const headers = { "x-stochvi-token": token };
const heard = [];
let running = null;

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
  on: (_, hear) => heard.push(hear),
  // a new turn ends the work on the last one
  async send(message) {
    const tell = (answer) => heard.forEach((hear) => hear(answer));
    if (message.type === "turn") running?.abort();
    const own = new AbortController();
    if (message.type === "turn") running = own;
    try {
      const body = JSON.stringify(message);
      const reply = await fetch("ask", { method: "POST", headers, body, signal: own.signal });
      if (!reply.ok) throw new Error(reply.status === 403 ? "open the address that stochvi explore printed" : await reply.text());
      await lines(reply, tell);
    } catch (error) {
      if (error.name !== "AbortError") tell({ type: "refused", id: message.id, sentence: `No answer: ${error.message}` });
    }
  },
};

// the server ends soon after its last tab, which it knows by this request
(async () => {
  try {
    const reply = await fetch("alive", { headers });
    if (!reply.ok) return; // told by the first answer
    await lines(reply, () => {});
  } catch { /* told below */ }
  heard.forEach((hear) => hear({ type: "ended" }));
})();

explore.render({ model, el: document.getElementById("explore") });
