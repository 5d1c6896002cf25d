// Time from left to right: a ruler with the playhead, and a row for each thing with its key times and words.

import { begin, colour, diamond, placeOf } from "./drawing.js";

const LEFT_PX = 100;
const RIGHT_PX = 16;
const RULER_PX = 24;
const ROW_PX = 26;

export class Timeline {
  // `scrub(time)`, `choose(name, key)`, `move(name, key, time)` and `add(name, time)` are told.
  constructor(canvas, stage, prompt, told) {
    Object.assign(this, { canvas, stage, prompt, told, held: null, shown: null });
    canvas.style.height = `${RULER_PX + ROW_PX * prompt.things.length + 4}px`;
    canvas.addEventListener("pointerdown", (event) => this.grab(event));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { this.held = null; });
    canvas.addEventListener("dblclick", (event) => this.add(event));
  }

  get span() {
    return (this.prompt.frames - 1) / this.prompt.rate || 1 / this.prompt.rate;
  }

  x(time) {
    return LEFT_PX + time / this.span * (this.canvas.clientWidth - LEFT_PX - RIGHT_PX);
  }

  time(x) {
    const share = (x - LEFT_PX) / (this.canvas.clientWidth - LEFT_PX - RIGHT_PX);
    return Math.min(Math.max(share, 0), 1) * this.span;
  }

  // `chosen`: {thing, key}; `ready`: shares of time that pictures are there for, [[from, to]], s.
  draw({ time, chosen, ready }) {
    this.shown = { time, chosen };
    const { context, width, height } = begin(this.canvas);
    this.ruler(context, width, ready);
    this.prompt.things.forEach((thing, row) => this.row(context, width, thing, RULER_PX + row * ROW_PX));
    const x = this.x(time);
    context.strokeStyle = context.fillStyle = colour("--accent");
    context.lineWidth = 1.6;
    context.beginPath();
    context.moveTo(x, 6);
    context.lineTo(x, height);
    context.stroke();
    context.beginPath();
    context.moveTo(x - 6, 2);
    context.lineTo(x + 6, 2);
    context.lineTo(x, 12);
    context.closePath();
    context.fill();
    this.canvas.setAttribute("aria-valuemax", this.span.toFixed(2));
    this.canvas.setAttribute("aria-valuenow", time.toFixed(2));
  }

  ruler(context, width, ready) {
    const room = width - LEFT_PX - RIGHT_PX;
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60].find((each) => each / this.span * room >= 46) ?? 120;
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "top";
    context.textAlign = "center";
    for (let tick = 0; tick * step <= this.span + 1e-6; tick += 1) {
      const x = this.x(tick * step);
      context.fillStyle = colour("--line");
      context.fillRect(x - 0.5, RULER_PX - 7, 1, 7);
      context.fillStyle = colour("--quiet");
      context.fillText(`${(tick * step).toFixed(step < 1 ? 1 : 0)} s`, x, 3);
    }
    context.fillStyle = colour("--accent");
    context.globalAlpha = 0.5;
    for (const [from, to] of ready ?? []) {
      context.fillRect(this.x(from), RULER_PX - 3, Math.max(1, this.x(to) - this.x(from)), 3);
    }
    context.globalAlpha = 1;
  }

  row(context, width, thing, top) {
    const middle = top + ROW_PX / 2;
    context.fillStyle = colour("--soft");
    context.fillRect(LEFT_PX, top + 2, width - LEFT_PX - RIGHT_PX, ROW_PX - 4);
    context.fillStyle = colour("--ink");
    context.font = "13px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillText(thing.label, 0, middle);
    this.words(context, thing, top);
    for (const key of this.prompt.keysOf(thing.name)) {
      const chosen = key === this.shown.chosen?.key;
      diamond(context, this.x(key.time), middle, chosen ? 8.5 : 6.5);
      context.fillStyle = colour(thing.colour);
      context.strokeStyle = colour(chosen ? "--ink" : "--card");
      context.lineWidth = 1.8;
      context.fill();
      context.stroke();
    }
  }

  words(context, thing, top) {
    const player = this.stage.players.find((each) => each.name === thing.name);
    for (const { from, to, text } of this.prompt.texts.get(player?.number) ?? []) {
      if (!text.trim()) continue;
      const [left, right] = [this.x(Math.min(from, this.span)), this.x(Math.min(to ?? this.span, this.span))];
      context.save();
      context.beginPath();
      context.roundRect(left, top + 3, Math.max(2, right - left), ROW_PX - 6, 5);
      context.clip();
      context.globalAlpha = 0.2;
      context.fillStyle = colour(thing.colour);
      context.fillRect(left, top, right - left, ROW_PX);
      context.globalAlpha = 1;
      context.fillStyle = colour("--ink");
      context.font = "12px system-ui, sans-serif";
      context.fillText(text.trim().replace(/\s+/g, " "), left + 12, top + ROW_PX / 2);
      context.restore();
    }
  }

  thingAt(y) {
    return this.prompt.things[Math.floor((y - RULER_PX) / ROW_PX)];
  }

  keyAt(x, y) {
    const thing = y >= RULER_PX ? this.thingAt(y) : undefined;
    if (!thing) return null;
    const keys = this.prompt.keysOf(thing.name).map((key) => ({ thing, key, off: this.x(key.time) - x }));
    const nearest = keys.sort((a, b) => Math.abs(a.off) - Math.abs(b.off))[0];
    return nearest && Math.abs(nearest.off) < 9 ? nearest : null;
  }

  grab(event) {
    if (event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    const [x, y] = placeOf(event);
    const found = this.keyAt(x, y);
    if (found) {
      this.held = found;
      this.told.choose(found.thing.name, found.key);
      this.told.scrub(found.key.time);
    } else {
      this.held = { off: 0 };
      this.told.scrub(this.time(x));
    }
  }

  drag(event) {
    const [x, y] = placeOf(event);
    if (!this.held) {
      this.canvas.style.cursor = this.keyAt(x, y) ? "ew-resize" : "default";
      return;
    }
    const time = this.time(x + this.held.off);
    if (this.held.key) this.told.move(this.held.thing.name, this.held.key, time);
    this.told.scrub(this.held.key ? this.held.key.time : time);
  }

  add(event) {
    const [x, y] = placeOf(event);
    const thing = y >= RULER_PX ? this.thingAt(y) : undefined;
    if (thing && !this.keyAt(x, y)) this.told.add(thing.name, this.time(x));
  }
}
