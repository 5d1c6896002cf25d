// What a person asks for: places of things at key times, words about players, length, rate and seed.

const near = (a, b) => Math.abs(a - b) < 1e-6;

export class Prompt {
  constructor(stage) {
    this.stage = stage;
    this.things = thingsOf(stage);
    this.length = 4;
    this.rate = stage.rates.usual;
    this.seed = 0;
    this.clear();
  }

  clear() {
    // By thing: [{time, place}], in the order of time.
    this.keys = new Map(this.things.map((thing) => [thing.name, []]));
    // By player's number: [{from, to, text}], s; a `to` of null is the end.
    this.texts = new Map(this.stage.players.filter((p) => p.speaks).map((p) => [p.number, [emptySaying()]]));
    // Values of an opened prompt that the page has no handle for: they go along as they are.
    this.more = [];
  }

  get frames() {
    return Math.max(1, Math.round(this.length * this.rate));
  }

  // Time of the frame nearest to a time, s.
  snapped(time) {
    return Math.min(Math.max(Math.round(time * this.rate), 0), this.frames - 1) / this.rate;
  }

  keyAt(name, time) {
    return this.keys.get(name).find((key) => near(key.time, this.snapped(time)));
  }

  // Fix where a thing is at a time; the key.
  put(name, time, place) {
    const at = this.snapped(time);
    let key = this.keyAt(name, at);
    if (!key) {
      key = { time: at, place: [...place] };
      this.keys.get(name).push(key);
    }
    key.place = place.map((number) => Math.round(number * 1000) / 1000);
    this.sort(name);
    return key;
  }

  // Move a key to another time; one that is there already gives way.
  move(name, key, time) {
    const at = this.snapped(time);
    if (near(at, key.time)) return;
    this.keys.set(name, this.keys.get(name).filter((other) => other === key || !near(other.time, at)));
    key.time = at;
    this.sort(name);
  }

  drop(name, key) {
    this.keys.set(name, this.keys.get(name).filter((other) => other !== key));
  }

  sort(name) {
    this.keys.get(name).sort((a, b) => a.time - b.time);
  }

  // Keys within the length.
  keysOf(name) {
    return this.keys.get(name).filter((key) => Math.round(key.time * this.rate) < this.frames);
  }

  // Where a thing is wished to be at a time: on the line between keys; where it usually is without any.
  wish(thing, time) {
    const keys = this.keysOf(thing.name);
    if (!keys.length) return thing.start;
    const after = keys.findIndex((key) => key.time >= time - 1e-9);
    if (after === 0) return keys[0].place;
    if (after < 0) return keys[keys.length - 1].place;
    const [a, b] = [keys[after - 1], keys[after]];
    const share = (time - a.time) / (b.time - a.time);
    return a.place.map((number, axis) => number + share * (b.place[axis] - number));
  }

  // The document of the schema `prompt`.
  toDocument() {
    const values = this.more.filter(({ whole, end_frame: end }) => whole || end <= this.frames)
      .map(({ whole, ...entry }) => (whole ? { ...entry, end_frame: this.frames } : entry));
    for (const thing of this.things) {
      const byFrame = new Map(this.keysOf(thing.name).map((key) => [Math.round(key.time * this.rate), key.place]));
      for (const [frame, place] of [...byFrame].sort((a, b) => a[0] - b[0])) {
        values.push({ column: thing.column, start_frame: frame, end_frame: frame + 1, value: place });
      }
    }
    const texts = [];
    for (const [player, sayings] of this.texts) {
      for (const { from, to, text } of sayings) {
        if (!text.trim()) continue;
        const [start, end] = [Math.round(from * this.rate), to === null ? this.frames : Math.round(to * this.rate)];
        texts.push({ player, start_frame: start, end_frame: Math.min(end, this.frames), text: text.trim() });
      }
    }
    const { frames: n_frames, rate: frames_per_second, seed } = this;
    return { scene: this.stage.scene, n_frames, frames_per_second, seed, texts, values };
  }

  // Go on from one moment of a rally: all of it is given at time 0, and the words stay.
  begin({ changing, constant }) {
    const { texts } = this;
    this.clear();
    this.texts = texts;
    for (const { column, value } of changing) {
      const thing = this.things.find((each) => each.column === column);
      if (thing) this.keys.get(thing.name).push({ time: 0, place: value });
      else this.more.push({ column, start_frame: 0, end_frame: 1, value });
    }
    for (const { column, value } of constant) this.more.push({ column, start_frame: 0, end_frame: 1, value, whole: true });
  }

  // Take over a document; the columns that go along without being shown come back.
  fromDocument(raw) {
    if (typeof raw !== "object" || raw === null || !(raw.n_frames > 0) || !(raw.frames_per_second > 0)) {
      throw new Error("expected a prompt of pgm animate, got another file");
    }
    if (raw.scene !== this.stage.scene) throw new Error(`scene: expected ${this.stage.scene}, got ${raw.scene}`);
    this.rate = raw.frames_per_second;
    this.length = raw.n_frames / raw.frames_per_second;
    this.seed = raw.seed ?? 0;
    this.clear();
    for (const { player, start_frame: start, end_frame: end, text } of raw.texts ?? []) {
      if (!this.texts.has(player)) throw new Error(`player: expected one of ${[...this.texts.keys()]}, got ${player}`);
      const sayings = this.texts.get(player).filter((saying) => saying.text);
      sayings.push({ from: start / this.rate, to: end >= raw.n_frames ? null : end / this.rate, text });
      this.texts.set(player, sayings);
    }
    for (const entry of raw.values ?? []) {
      const { column, start_frame: start, end_frame: end, value } = entry;
      const thing = this.things.find((each) => each.column === column);
      const rows = Array.isArray(value) && Array.isArray(value[0]) ? value : Array(end - start).fill(value);
      if (!thing) this.more.push(entry);
      else rows.forEach((row, place) => this.put(thing.name, (start + place) / this.rate, row));
    }
    return [...new Set(this.more.map((entry) => entry.column))];
  }
}

export const emptySaying = () => ({ from: 0, to: null, text: "" });

// What can be moved, in the order of the scene: name, label, column, where it usually is, CSS variable of its colour.
function thingsOf(stage) {
  const colours = ["--one", "--two", "--three", "--four"];
  const things = stage.players.filter((player) => player.column).map((player) => ({
    name: player.name,
    label: player.label,
    column: player.column,
    start: player.start,
    colour: colours[player.number % colours.length],
    ball: false,
  }));
  if (stage.ball) {
    const { column, start } = stage.ball;
    things.push({ name: "ball", label: "Ball", column, start, colour: "--ball", ball: true });
  }
  return things;
}
