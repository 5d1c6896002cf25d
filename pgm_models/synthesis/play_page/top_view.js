// The scene from above. What is dragged is fixed at the playhead's time; marks of other times can be dragged too.

import { begin, colour, diamond, disc, placeOf, plate } from "./drawing.js";

const MARGIN_PX = 14;
const BODY_M = 0.45;
const AHEAD_PX = 5;
const RECENT_S = 1;
const GRID_M = 2;

export class TopView {
  // `put(name, place)` and `change(name, key, place)` are told of drags, `choose(name, key)` of clicks.
  constructor(canvas, stage, prompt, told) {
    Object.assign(this, { canvas, stage, prompt, told, held: null, over: null, shown: null });
    canvas.addEventListener("pointerdown", (event) => this.grab(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => this.release());
  }

  // How wide the view wants to be, for its height.
  get aspect() {
    const [low, high] = this.stage.area;
    return (high[0] - low[0] + 1) / (high[1] - low[1] + 1);
  }

  fit(width, height) {
    const [low, high] = this.stage.area;
    const [wide, long] = [high[0] - low[0], high[1] - low[1]];
    this.scale = Math.min((width - 2 * MARGIN_PX) / wide, (height - 2 * MARGIN_PX) / long);
    this.left = (width - this.scale * (low[0] + high[0])) / 2;
    this.bottom = (height + this.scale * (low[1] + high[1])) / 2;
  }

  px([x, y]) {
    return [this.left + this.scale * x, this.bottom - this.scale * y];
  }

  metres([x, y]) {
    return [(x - this.left) / this.scale, (this.bottom - y) / this.scale];
  }

  draw(shown) {
    this.shown = shown;
    const { context, width, height } = begin(this.canvas);
    this.fit(width, height);
    this.ground(context, width, height);
    for (const thing of this.prompt.things) this.paths(context, thing);
    for (const thing of this.prompt.things) this.marks(context, thing);
    for (const player of this.stage.players) this.player(context, player);
    if (shown.ball) this.ball(context, shown.ball);
    if (this.over || this.held) this.label(context, this.held ?? this.over);
  }

  ground(context, width, height) {
    const { stage } = this;
    const [low, high] = stage.area;
    context.fillStyle = colour("--apron");
    context.beginPath();
    context.roundRect(0, 0, width, height, 10);
    context.fill();
    if (stage.surface) {
      const [x, y] = this.px([-stage.surface[0], stage.surface[1]]);
      context.fillStyle = colour("--court");
      context.fillRect(x, y, 2 * stage.surface[0] * this.scale, 2 * stage.surface[1] * this.scale);
    } else {
      this.grid(context, low, high);
    }
    context.strokeStyle = colour("--paint");
    for (const { ends, width: wide } of stage.lines) {
      context.lineWidth = Math.max(1, wide * this.scale);
      this.line(context, ends);
    }
    context.strokeStyle = colour("--net");
    context.lineWidth = 2;
    if (stage.net.length) this.line(context, stage.net);
    const metres = high[0] - low[0] > 12 ? 5 : 1;
    context.fillStyle = context.strokeStyle = colour("--quiet");
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(12, height - 10);
    context.lineTo(12 + metres * this.scale, height - 10);
    context.stroke();
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "bottom";
    context.fillText(`${metres} m`, 12, height - 13);
  }

  grid(context, low, high) {
    context.strokeStyle = colour("--grid");
    context.lineWidth = 1;
    for (let x = Math.ceil(low[0] / GRID_M) * GRID_M; x <= high[0]; x += GRID_M) {
      this.line(context, [[x, low[1]], [x, high[1]]]);
    }
    for (let y = Math.ceil(low[1] / GRID_M) * GRID_M; y <= high[1]; y += GRID_M) {
      this.line(context, [[low[0], y], [high[0], y]]);
    }
  }

  line(context, points) {
    context.beginPath();
    points.forEach((point, number) => context[number ? "lineTo" : "moveTo"](...this.px(point)));
    context.stroke();
  }

  // Where the rally leads the thing: all of it faintly, the last moment clearly.
  paths(context, thing) {
    const path = this.shown.paths?.get(thing.name);
    if (!path) return;
    context.strokeStyle = colour(thing.ball ? "--ballrim" : thing.colour);
    const now = Math.floor(this.shown.time * this.shown.rate);
    const recent = Math.max(0, now - Math.round(RECENT_S * this.shown.rate));
    for (const [points, alpha, width] of [[path, 0.28, 1.2], [path.slice(recent, now + 1), 0.85, 2]]) {
      context.globalAlpha = alpha;
      context.lineWidth = width;
      let open = false;
      context.beginPath();
      for (const point of points) {
        if (point) context[open ? "lineTo" : "moveTo"](...this.px(point));
        open = Boolean(point);
      }
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  // The places that are fixed, joined in the order of time.
  marks(context, thing) {
    const keys = this.prompt.keysOf(thing.name);
    if (!keys.length) return;
    context.strokeStyle = colour(thing.ball ? "--ballrim" : thing.colour);
    context.lineWidth = 1.2;
    context.setLineDash([3, 4]);
    this.line(context, keys.map((key) => key.place));
    context.setLineDash([]);
    for (const key of keys) {
      const [x, y] = this.px(key.place);
      diamond(context, x, y, key === this.shown.chosen?.key ? 8 : 5.5);
      context.fillStyle = colour(thing.colour);
      context.strokeStyle = colour(key === this.shown.chosen?.key ? "--ink" : "--card");
      context.lineWidth = 1.8;
      context.fill();
      context.stroke();
    }
  }

  player(context, player) {
    const pose = this.shown.players[player.number];
    if (!pose.root) return;
    const thing = this.prompt.things.find((each) => each.name === player.name);
    const ink = colour(thing?.colour ?? "--quiet");
    const [x, y] = this.px(pose.root);
    disc(context, x, y, Math.max(10, BODY_M * this.scale));
    context.globalAlpha = 0.25;
    context.fillStyle = ink;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = ink;
    context.lineWidth = 2;
    context.setLineDash(pose.wished ? [4, 4] : []);
    context.stroke();
    context.setLineDash([]);
    if (pose.joints) {
      context.lineWidth = Math.max(2, 0.09 * this.scale);
      context.beginPath();
      player.parents.forEach((parent, joint) => {
        if (parent < 0) return;
        context.moveTo(...this.px(pose.joints.slice(3 * parent)));
        context.lineTo(...this.px(pose.joints.slice(3 * joint)));
      });
      context.stroke();
    } else {
      disc(context, x, y, 3.5);
      context.fillStyle = ink;
      context.fill();
    }
  }

  ball(context, { place, wished }) {
    const [x, y] = this.px(place);
    const radius = 5 + 1.1 * Math.min(Math.max(place[2], 0), 6);
    disc(context, x, y, radius);
    context.fillStyle = colour("--ball");
    context.globalAlpha = wished ? 0.55 : 1;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = colour("--ballrim");
    context.lineWidth = 1.6;
    context.setLineDash(wished ? [3, 3] : []);
    context.stroke();
    context.setLineDash([]);
  }

  label(context, { thing, key }) {
    const place = key ? key.place : this.placeOfThing(thing);
    if (!place) return;
    const [x, y] = this.px(place);
    const when = key ? ` at ${key.time.toFixed(2)} s` : "";
    const high = thing.ball ? `, ${place[2].toFixed(1)} m high` : "";
    const half = 4 * (thing.label.length + when.length + high.length);
    const middle = Math.min(Math.max(x, half), this.canvas.clientWidth - half);
    plate(context, `${thing.label}${when}${high}`, middle, y > 40 ? y - 24 : y + 24, colour("--ink"));
  }

  placeOfThing(thing) {
    if (thing.ball) return this.shown.ball?.place;
    return this.shown.players[this.stage.players.findIndex((player) => player.name === thing.name)].root;
  }

  // What is under a pixel: the nearest; where a thing stands on its own mark, the thing, at the playhead's time.
  under(at) {
    let [best, least] = [null, Infinity];
    const consider = (thing, key, place, reach, ahead) => {
      if (!place) return;
      const [x, y] = this.px(place);
      const far = Math.hypot(x - at[0], y - at[1]);
      if (far <= reach && far - ahead < least) [best, least] = [{ thing, key }, far - ahead];
    };
    for (const thing of this.prompt.things) {
      const reach = thing.ball ? 14 : Math.max(14, BODY_M * this.scale + 3);
      for (const key of this.prompt.keysOf(thing.name)) consider(thing, key, key.place, 9, 0);
      consider(thing, null, this.placeOfThing(thing), reach, thing.ball ? AHEAD_PX + 2 : AHEAD_PX);
    }
    return best;
  }

  grab(event) {
    if (!this.shown || event.button !== 0) return;
    const at = placeOf(event);
    const found = this.under(at);
    this.told.choose(found?.thing.name, found?.key ?? undefined);
    if (!found) return;
    this.canvas.setPointerCapture(event.pointerId);
    const place = found.key ? found.key.place : this.placeOfThing(found.thing);
    const [x, y] = this.px(place);
    this.held = { ...found, off: [x - at[0], y - at[1]], height: place[2], from: at, moved: false };
  }

  move(event) {
    if (!this.shown) return;
    const at = placeOf(event);
    if (!this.held) {
      const before = this.over;
      this.over = this.under(at);
      this.canvas.style.cursor = this.over ? "grab" : "default";
      if (before?.thing !== this.over?.thing || before?.key !== this.over?.key) this.told.look();
      return;
    }
    const { held } = this;
    if (!held.moved && Math.hypot(at[0] - held.from[0], at[1] - held.from[1]) < 3) return;
    held.moved = true;
    this.canvas.style.cursor = "grabbing";
    const [low, high] = this.stage.area;
    const place = this.metres([at[0] + held.off[0], at[1] + held.off[1]])
      .map((number, axis) => Math.min(Math.max(number, low[axis]), high[axis]));
    place.push(held.height);
    if (held.key) this.told.change(held.thing.name, held.key, place);
    else held.key = this.told.put(held.thing.name, place);
  }

  release() {
    this.held = null;
    this.canvas.style.cursor = "default";
    this.told.look();
  }
}
