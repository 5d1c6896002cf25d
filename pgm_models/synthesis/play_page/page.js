// The page: what is asked for, what came of it, and the clock that plays it.

import { onTheme } from "./drawing.js";
import { FigureView } from "./figure_view.js";
import { Panel } from "./panel.js";
import { Pictures } from "./pictures.js";
import { Prompt } from "./prompt.js";
import * as server from "./server.js";
import { Timeline } from "./timeline.js";
import { TopView } from "./top_view.js";

const POLL_MS = 250;
const SPEEDS = [0.25, 0.5, 1];
const element = (id) => document.getElementById(id);

class Page {
  constructor(stage) {
    Object.assign(this, { stage, time: 0, playing: false, speed: 1, chosen: null, rally: null, rallies: [], rendered: false });
    this.prompt = new Prompt(stage);
    const look = () => this.look();
    this.pictures = new Pictures(look, (words) => this.trouble(`No picture: ${words}`));
    this.view = new FigureView(element("figures"), stage, look);
    this.top = new TopView(element("topview"), stage, this.prompt, {
      look,
      choose: (name, key) => this.choose(name, key),
      put: (name, place) => this.put(name, place),
      change: (name, key, place) => this.change(name, key, place),
    });
    this.timeline = new Timeline(element("timeline"), stage, this.prompt, {
      scrub: (time) => this.scrub(time),
      choose: (name, key) => this.choose(name, key),
      move: (name, key, time) => { this.prompt.move(name, key, time); this.choose(name, key); },
      add: (name, time) => { this.scrub(time); this.put(name, this.placeOf(name)); },
    });
    this.panel = new Panel(stage, this.prompt, {
      changed: () => { this.time = Math.min(this.time, this.span); this.look(); },
      freed: () => this.free(),
      opened: () => { this.chosen = null; this.scrub(0); },
    });
    this.buttons();
    document.documentElement.style.setProperty("--topshare", `${Math.min(Math.max(1.5 * this.top.aspect, 0.95), 1.9)}fr`);
    onTheme(look);
    new ResizeObserver(look).observe(document.querySelector("main"));
    const names = [stage.scene, stage.animation, stage.synthesis].filter(Boolean);
    element("models").textContent = names.join(" · ");
    document.title = `${stage.scene} · pgm play`;
    this.look();
  }

  // Length of what is asked for, s.
  get span() {
    return this.timeline.span;
  }

  // Where playing begins again: at the end of the rally, where that is shorter.
  get end() {
    return this.rally ? Math.min(this.span, (this.rally.frames - 1) / this.rally.rate) : this.span;
  }

  thing(name) {
    return this.prompt.things.find((each) => each.name === name);
  }

  // What is shown at the playhead: the rally's states, or where things are wished to be.
  get shown() {
    const { rally, time, chosen, stage, prompt } = this;
    const frame = rally ? Math.min(Math.floor(time * rally.rate + 1e-6), rally.frames - 1) : 0;
    const players = stage.players.map((player) => {
      const own = rally?.players[player.number];
      if (own?.root) return { root: own.root[frame], joints: own.joints?.[frame] ?? null, wished: false };
      const thing = this.thing(player.name);
      if (!thing) return { root: null };
      return { root: prompt.wish(thing, time), joints: null, wished: !prompt.keysOf(player.name).length };
    });
    let ball = null;
    if (stage.ball) {
      const place = rally?.ball ? rally.ball[frame] : prompt.wish(this.thing("ball"), time);
      ball = place && { place, wished: !rally?.ball && !prompt.keysOf("ball").length };
    }
    return { time, frame, rate: rally?.rate ?? prompt.rate, players, ball, chosen, paths: this.rally?.paths };
  }

  // Draw before the next picture of the screen.
  look() {
    this.waiting ??= requestAnimationFrame((now) => { this.waiting = null; this.draw(now); });
  }

  draw(now) {
    if (this.playing) this.advance(now);
    const { shown } = this;
    const wanted = this.rendered && this.rally;
    this.pictures.of(wanted ? this.rally : null, this.view, this.size);
    const picture = wanted ? this.pictures.at(shown.frame) : null;
    this.top.draw(shown);
    this.view.draw(shown, picture);
    this.timeline.draw({ time: this.time, chosen: this.chosen, ready: this.pictures.spans });
    const some = wanted && this.pictures.count < this.rally.frames && !this.pictures.stopped;
    element("buffering").hidden = !some;
    if (some) element("buffering").textContent = `rendering ${this.pictures.count} of ${this.rally.frames}`;
    element("clock").textContent = `${this.time.toFixed(2)} s of ${this.span.toFixed(2)} s`;
    element("usual").hidden = !this.view.orbit;
    element("goon").hidden = !this.rally;
    element("play").classList.toggle("on", this.playing);
    this.panel.key(this.chosen);
    if (this.playing) this.look();
  }

  advance(now) {
    const step = Math.min((now - (this.clock ?? now)) / 1000, 0.1) * this.speed;
    this.clock = now;
    let time = this.time + step;
    if (time > this.end) time = 0;
    // Pictures that are not there yet are waited for, so that what is seen is one thing.
    if (this.rendered && this.rally && !this.pictures.stopped) {
      const frame = Math.min(Math.floor(time * this.rally.rate + 1e-6), this.rally.frames - 1);
      if (!this.pictures.has(frame)) {
        this.pictures.at(frame);
        return;
      }
    }
    this.time = time;
  }

  setPlaying(playing) {
    this.playing = playing;
    this.clock = null;
    if (playing && this.time >= this.end - 1e-6) this.time = 0;
    element("play").setAttribute("aria-label", playing ? "pause" : "play");
    this.look();
  }

  scrub(time) {
    this.setPlaying(false);
    this.time = this.prompt.snapped(time);
    if (this.chosen?.key && Math.abs(this.chosen.key.time - this.time) > 1e-6) this.chosen = null;
    this.look();
  }

  choose(name, key) {
    this.chosen = name && key ? { thing: this.thing(name), key } : null;
    if (key) {
      this.setPlaying(false);
      this.time = key.time;
    }
    this.look();
  }

  placeOf(name) {
    const thing = this.thing(name);
    const place = this.top.shown && (thing.ball ? this.shown.ball?.place
      : this.shown.players[this.stage.players.findIndex((player) => player.name === name)].root);
    return place ?? this.prompt.wish(thing, this.time);
  }

  put(name, place) {
    this.setPlaying(false);
    this.time = this.prompt.snapped(this.time);
    const key = this.prompt.put(name, this.time, place);
    this.choose(name, key);
    return key;
  }

  change(name, key, place) {
    key.place = place.map((number) => Math.round(number * 1000) / 1000);
    this.choose(name, key);
  }

  free() {
    if (!this.chosen) return;
    this.prompt.drop(this.chosen.thing.name, this.chosen.key);
    this.chosen = null;
    this.look();
  }

  trouble(words) {
    element("trouble").hidden = !words;
    element("trouble").textContent = words;
  }

  async make() {
    this.trouble("");
    this.busy(true, { share: 0, words: "asking" });
    try {
      this.making = await server.order(this.prompt.toDocument());
      await this.wait(this.making);
    } catch (error) {
      this.trouble(error.message);
    }
    this.making = null;
    this.busy(false);
  }

  async wait(name) {
    for (;;) {
      const { state, share, words } = await server.progress(name);
      if (state === "failed") throw new Error(words);
      if (state === "cancelled") return;
      if (state === "done") break;
      this.busy(true, { share, words });
      await new Promise((done) => setTimeout(done, POLL_MS));
    }
    this.took(name, await server.states(name));
  }

  busy(busy, { share, words } = {}) {
    element("make").disabled = busy;
    element("cancel").hidden = !busy;
    element("progress").hidden = !busy;
    element("state").textContent = busy ? "generating" : "";
    if (!busy) return;
    element("bar").firstElementChild.style.width = `${100 * share}%`;
    element("bar").setAttribute("aria-valuenow", Math.round(100 * share));
    element("doing").textContent = words;
  }

  // A rally has come.
  took(name, rally) {
    rally.name = name;
    rally.paths = new Map(this.stage.players.map((player) => [player.name, rally.players[player.number].root]));
    rally.paths.set("ball", rally.ball);
    this.rallies.push(rally);
    element("rallies").hidden = this.rallies.length < 2;
    const option = new Option(`${name}: seed ${rally.prompt.seed ?? 0}, ${(rally.frames / rally.rate).toFixed(1)} s`, name);
    element("rally").append(option);
    this.show(rally);
  }

  show(rally) {
    this.rally = rally;
    element("rally").value = rally.name;
    this.view.follow(rally.camera);
    this.panel.said(rally);
    this.time = 0;
    this.setPlaying(true);
  }

  // The moment at the playhead begins the next rally.
  async goOn() {
    this.setPlaying(false);
    try {
      this.prompt.begin(await server.values(this.rally.name, this.shown.frame));
    } catch (error) {
      this.trouble(error.message);
      return;
    }
    this.trouble("");
    this.rally = null;
    this.chosen = null;
    this.view.follow(null);
    element("rally").selectedIndex = -1;
    element("said").hidden = true;
    this.scrub(0);
  }

  async cancel() {
    try {
      if (this.making) await server.cancel(this.making);
    } catch (error) {
      this.trouble(error.message);
    }
  }

  buttons() {
    element("make").onclick = () => this.make();
    element("cancel").onclick = () => this.cancel();
    element("play").onclick = () => this.setPlaying(!this.playing);
    element("first").onclick = () => this.scrub(0);
    element("goon").onclick = () => this.goOn();
    element("usual").onclick = () => this.view.usual();
    element("rally").onchange = (event) => this.show(this.rallies.find((each) => each.name === event.target.value));
    for (const speed of SPEEDS) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = `${speed}\u00d7`;
      button.setAttribute("aria-pressed", speed === this.speed);
      button.onclick = () => {
        this.speed = speed;
        for (const each of element("speeds").children) each.setAttribute("aria-pressed", each === button);
      };
      element("speeds").append(button);
    }
    document.addEventListener("keydown", (event) => this.pressed(event));
    if (this.stage.renders) this.pictureButtons();
  }

  pictureButtons() {
    element("kinds").hidden = element("sizes").hidden = false;
    const [width, height] = this.stage.picture;
    const sizes = [0.5, 1, 2].map((scale) => [Math.max(1, Math.round(scale * width)), Math.max(1, Math.round(scale * height))])
      .filter(([wide, high], place) => place < 2 || wide * high <= this.stage.most_pixels);
    for (const [wide, high] of sizes) element("size").append(new Option(`${wide} \u00d7 ${high}`, `${wide} ${high}`));
    element("size").selectedIndex = 1;
    this.size = sizes[1];
    element("size").onchange = (event) => {
      this.size = event.target.value.split(" ").map(Number);
      this.look();
    };
    const choose = (rendered) => {
      this.rendered = rendered;
      element("asfigures").setAttribute("aria-pressed", !rendered);
      element("aspictures").setAttribute("aria-pressed", rendered);
      this.look();
    };
    element("asfigures").onclick = () => choose(false);
    element("aspictures").onclick = () => choose(true);
    choose(true);
  }

  pressed(event) {
    if (event.target.matches("input, textarea, select") || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = (event.shiftKey ? 10 : 1) / this.prompt.rate;
    const actions = {
      " ": () => this.setPlaying(!this.playing),
      ArrowLeft: () => this.scrub(this.time - step),
      ArrowRight: () => this.scrub(this.time + step),
      Home: () => this.scrub(0),
      End: () => this.scrub(this.span),
      Delete: () => this.free(),
      Backspace: () => this.free(),
    };
    // A focused button is pressed by the space bar itself.
    if (!(event.key in actions) || (event.key === " " && event.target.matches("button, summary"))) return;
    event.preventDefault();
    actions[event.key]();
  }
}

try {
  window.page = new Page(await server.stage());
  document.body.dataset.ready = "yes";
} catch (error) {
  element("trouble").hidden = false;
  element("trouble").textContent = error.message;
}
