// Rendered pictures of one rally from one view, asked for one at a time: what is looked at first, then what follows.

import { sized } from "./camera.js";
import { ServerError, picture } from "./server.js";

const DECODED = 40;
const AHEAD = 4;

export class Pictures {
  // `look` is called when a picture came, `trouble(words)` when none can be had.
  constructor(look, trouble) {
    Object.assign(this, { look, trouble, blobs: new Map(), bitmaps: new Map(), key: null, asking: null, stopped: false });
  }

  // Begin anew where rally, view or size changed.
  of(rally, view, size) {
    const key = rally && `${rally.name} ${view.version} ${size}`;
    if (key === this.key) return;
    this.key = key;
    this.rally = rally;
    this.view = view;
    this.size = size;
    this.stopped = false;
    this.asking?.abort();
    this.asking = null;
    this.blobs.clear();
    for (const bitmap of this.bitmaps.values()) bitmap.close?.();
    this.bitmaps.clear();
  }

  get count() {
    return this.blobs.size;
  }

  has(frame) {
    return this.blobs.has(frame);
  }

  // The picture of a frame if it is at hand; what is wanted next is seen to.
  at(frame) {
    if (!this.rally) return null;
    this.ask(frame);
    for (let next = frame; next < Math.min(frame + AHEAD, this.rally.frames); next += 1) this.decode(next);
    return this.bitmaps.get(frame) ?? null;
  }

  async decode(frame) {
    if (this.bitmaps.has(frame) || !this.blobs.has(frame)) return;
    const { key } = this;
    this.bitmaps.set(frame, null);
    const bitmap = await createImageBitmap(this.blobs.get(frame));
    if (key !== this.key) return;
    this.bitmaps.set(frame, bitmap);
    for (const old of this.bitmaps.keys()) {
      if (this.bitmaps.size <= DECODED) break;
      this.bitmaps.get(old)?.close();
      this.bitmaps.delete(old);
    }
    this.look();
  }

  // The first frame from there on, round and round, that no picture is there of.
  next(frame) {
    for (let step = 0; step < this.rally.frames; step += 1) {
      const found = (frame + step) % this.rally.frames;
      if (!this.blobs.has(found)) return found;
    }
    return null;
  }

  async ask(frame) {
    if (this.asking || this.stopped) return;
    const wanted = this.next(frame);
    if (wanted === null) return;
    const [key, control] = [this.key, new AbortController()];
    this.asking = control;
    const { width, height, K, distortion, R, t } = sized(this.view.camera(wanted), ...this.size);
    try {
      const camera = { width, height, K, distortion, R_cam_from_world: R, t_cam_from_world: t };
      const blob = await picture(this.rally.name, wanted, camera, control.signal);
      if (key !== this.key) return;
      this.blobs.set(wanted, blob);
    } catch (error) {
      if (error.name === "AbortError" || key !== this.key) return;
      this.stopped = true;
      this.trouble(error instanceof ServerError ? error.message : String(error));
    } finally {
      if (this.asking === control) this.asking = null;
    }
    this.look();
  }

  // Spans of time that pictures are there for, s.
  get spans() {
    const spans = [];
    if (!this.rally) return spans;
    for (let frame = 0; frame < this.rally.frames; frame += 1) {
      if (!this.blobs.has(frame)) continue;
      const [from, to] = [frame / this.rally.rate, (frame + 1) / this.rally.rate];
      if (spans.length && Math.abs(spans[spans.length - 1][1] - from) < 1e-6) spans[spans.length - 1][1] = to;
      else spans.push([from, to]);
    }
    return spans;
  }
}
