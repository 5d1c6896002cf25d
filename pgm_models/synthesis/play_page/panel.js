// The panel at the side: words of the players, length, rate and seed, the chosen place, and files.

import { emptySaying } from "./prompt.js";

const element = (id) => document.getElementById(id);
const EXAMPLES = ["serves wide and runs to the net", "returns the ball down the line", "walks to the corner and comes back"];

function made(tag, attributes = {}, ...children) {
  const node = Object.assign(document.createElement(tag), attributes);
  node.append(...children);
  return node;
}

export class Panel {
  // `changed()`, `freed()` and `opened()` are told.
  constructor(stage, prompt, told) {
    Object.assign(this, { stage, prompt, told });
    this.settings();
    this.texts();
    this.files();
    element("keydrop").onclick = () => told.freed();
    ["keyx", "keyy", "keyz"].forEach((id, axis) => {
      element(id).onchange = (event) => {
        const number = event.target.valueAsNumber;
        if (Number.isFinite(number) && this.shownKey) this.shownKey.place[axis] = number;
        told.changed();
      };
    });
  }

  settings() {
    const { stage, prompt, told } = this;
    const { low, high } = stage.rates;
    Object.assign(element("rate"), { min: low, max: high, value: prompt.rate, title: `learned at ${low} to ${high} Hz` });
    this.refresh();
    element("length").onchange = (event) => {
      const most = stage.most_frames / prompt.rate;
      prompt.length = Math.min(Math.max(event.target.valueAsNumber || 1, 1 / prompt.rate), most);
      this.refresh();
      told.changed();
    };
    element("rate").onchange = (event) => {
      prompt.rate = Math.min(Math.max(event.target.valueAsNumber || prompt.rate, 1), 1000);
      prompt.length = Math.min(prompt.length, stage.most_frames / prompt.rate);
      for (const thing of prompt.things) {
        const keys = prompt.keys.get(thing.name);
        prompt.keys.set(thing.name, []);
        for (const { time, place } of keys) prompt.put(thing.name, time, place);
      }
      this.refresh();
      told.changed();
    };
    element("seed").onchange = (event) => {
      prompt.seed = Math.max(0, Math.floor(event.target.valueAsNumber || 0));
      this.refresh();
    };
    element("dice").onclick = () => {
      prompt.seed = Math.floor(Math.random() * 1e6);
      this.refresh();
    };
  }

  refresh() {
    const { prompt } = this;
    element("length").value = Math.round(prompt.length * 1000) / 1000;
    element("rate").value = Math.round(prompt.rate * 1000) / 1000;
    element("seed").value = prompt.seed;
  }

  texts() {
    const cards = this.stage.players.filter((player) => player.speaks).map((player) => this.card(player));
    element("texts").replaceChildren(...cards);
  }

  card(player) {
    const dot = made("i");
    dot.style.background = `var(${["--one", "--two", "--three", "--four"][player.number % 4]})`;
    const more = made("button", { type: "button", className: "small bare", textContent: "+ then", title: "another stretch of time" });
    more.onclick = () => {
      const sayings = this.prompt.texts.get(player.number);
      const last = sayings[sayings.length - 1];
      const half = Math.round(5 * (last.from + (last.to ?? this.prompt.length))) / 10;
      last.to ??= half;
      sayings.push({ ...emptySaying(), from: last.to });
      this.texts();
      this.told.changed();
    };
    const card = made("div", { className: "card" }, made("div", { className: "who" }, dot, player.label, more));
    const sayings = this.prompt.texts.get(player.number);
    sayings.forEach((saying) => card.append(this.saying(player, saying, sayings)));
    return card;
  }

  saying(player, saying, sayings) {
    const area = made("textarea", {
      value: saying.text,
      placeholder: `the player ${EXAMPLES[this.stage.ball ? player.number % 2 : 2]}`,
      ariaLabel: `What ${player.label.toLowerCase()} does`,
      maxLength: 2000,
    });
    area.oninput = () => { saying.text = area.value; this.told.changed(); };
    const box = made("div", { className: "saying" }, area);
    if (sayings.length > 1) box.append(this.span(player, saying, sayings));
    return box;
  }

  span(player, saying, sayings) {
    const ends = ["from", "to"].map((end) => {
      const value = saying[end] ?? Math.round(this.prompt.length * 100) / 100;
      const input = made("input", { type: "number", min: 0, step: 0.1, value, ariaLabel: `${end}, seconds` });
      input.onchange = () => {
        const number = Math.max(0, input.valueAsNumber || 0);
        saying[end] = end === "to" && number >= this.prompt.length ? null : number;
        this.told.changed();
      };
      return input;
    });
    const drop = made("button", { type: "button", className: "small bare", textContent: "\u2715", title: "take away",
      ariaLabel: "take away" });
    drop.onclick = () => {
      sayings.splice(sayings.indexOf(saying), 1);
      if (sayings.length === 1) Object.assign(sayings[0], { from: 0, to: null });
      this.texts();
      this.told.changed();
    };
    return made("div", { className: "span" }, ends[0], "to", ends[1], "s", drop);
  }

  // Show the chosen place, or none.
  key(chosen) {
    element("key").hidden = !chosen;
    this.shownKey = chosen?.key ?? null;
    if (!chosen) return;
    element("keytitle").textContent = `${chosen.thing.label} at ${chosen.key.time.toFixed(2)} s`;
    ["keyx", "keyy", "keyz"].forEach((id, axis) => {
      if (document.activeElement !== element(id)) element(id).value = Math.round(chosen.key.place[axis] * 100) / 100;
    });
  }

  // What is to be said of a rally.
  said(rally) {
    const lines = [...rally.warnings.map((text) => made("li", { className: "warn", textContent: text })),
      ...rally.notes.map((text) => made("li", { textContent: text }))];
    const some = rally.warnings.length;
    element("said").hidden = !lines.length;
    element("said").firstElementChild.textContent = some ? `About this rally: ${some} warning${some > 1 ? "s" : ""}`
      : "About this rally";
    element("said").lastElementChild.replaceChildren(...lines);
  }

  files() {
    element("save").onclick = () => {
      const text = `${JSON.stringify(this.prompt.toDocument(), null, 2)}\n`;
      const link = made("a", { href: URL.createObjectURL(new Blob([text], { type: "application/json" })) });
      link.download = `${this.stage.scene}_prompt.json`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    };
    element("load").onclick = () => element("file").click();
    element("file").onchange = async (event) => {
      const [file] = event.target.files;
      event.target.value = "";
      if (!file) return;
      try {
        this.take(JSON.parse(await file.text()));
      } catch (error) {
        this.say(`${file.name}: ${error.message}`);
      }
    };
    element("clear").onclick = () => {
      this.prompt.clear();
      this.texts();
      this.told.opened();
    };
  }

  take(document_) {
    const along = this.prompt.fromDocument(document_);
    this.say(along.length ? `Goes along, though it is not shown here: ${along.join(", ")}` : "");
    this.refresh();
    this.texts();
    this.told.opened();
  }

  say(words) {
    element("trouble").hidden = !words;
    element("trouble").textContent = words;
  }
}
