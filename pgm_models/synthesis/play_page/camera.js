// A camera as in CAMERA.json: pixels' centres are whole numbers, x right, y down, z forward; world points in metres.

const NEAR_M = 0.1;

export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((number) => number / Math.hypot(...a));

// The camera of one frame out of those that the server tells of.
export function cameraOf(cameras, frame) {
  const pick = (list) => list[Math.min(frame, list.length - 1)];
  const { width, height, K, distortion, R, t } = cameras;
  return { width, height, K: pick(K), distortion, R: pick(R), t: pick(t) };
}

// The same view in a picture of another size: edges of pixels map onto edges.
export function sized(camera, width, height) {
  const scale = Math.min(width / camera.width, height / camera.height);
  const [fx, skew, cx, , fy, cy] = camera.K;
  const [padX, padY] = [(width - scale * camera.width) / 2, (height - scale * camera.height) / 2];
  const K = [scale * fx, scale * skew, (cx + 0.5) * scale - 0.5 + padX, 0, scale * fy, (cy + 0.5) * scale - 0.5 + padY,
    0, 0, 1];
  return { ...camera, width, height, K };
}

export function positionOf({ R, t }) {
  return [0, 1, 2].map((axis) => -(R[axis] * t[0] + R[3 + axis] * t[1] + R[6 + axis] * t[2]));
}

export function toCamera({ R, t }, point) {
  return [0, 1, 2].map((row) => R[3 * row] * point[0] + R[3 * row + 1] * point[1] + R[3 * row + 2] * point[2] + t[row]);
}

// Pixel of a point in camera axes, with the lens (k1, k2, p1, p2).
export function toPixel({ K, distortion }, [X, Y, Z]) {
  let [x, y] = [X / Z, Y / Z];
  const [k1, k2, p1, p2] = distortion;
  const r = x * x + y * y;
  const radial = 1 + k1 * r + k2 * r * r;
  [x, y] = [x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x), y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y];
  return [K[0] * x + K[1] * y + K[2], K[4] * y + K[5]];
}

// What of a polygon, or of a line, lies in front of the camera, in camera axes.
export function inFront(camera, points, closed) {
  const seen = points.map((point) => toCamera(camera, point));
  const kept = [];
  seen.forEach((point, place) => {
    const before = seen[place - 1] ?? (closed ? seen[seen.length - 1] : null);
    if (before && (before[2] > NEAR_M) !== (point[2] > NEAR_M)) {
      const share = (NEAR_M - before[2]) / (point[2] - before[2]);
      kept.push(before.map((number, axis) => number + share * (point[axis] - number)));
    }
    if (point[2] > NEAR_M) kept.push(point);
  });
  return kept;
}

// An upright camera on a sphere about a point that looks at it.
export class Orbit {
  constructor(camera, ground) {
    this.camera = camera;
    const position = positionOf(camera);
    const forward = camera.R.slice(6);
    // What it looks at: where its axis meets the ground, or the point of the axis nearest to the middle.
    const down = forward[2] < -0.05 ? (ground - position[2]) / forward[2] : -dot(position, forward);
    this.distance = Math.min(Math.max(down, 3), 120);
    this.aim = position.map((number, axis) => number + this.distance * forward[axis]);
    this.azimuth = Math.atan2(-forward[1], -forward[0]);
    this.elevation = Math.asin(Math.min(Math.max(-forward[2], -1), 1));
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.min(Math.max(this.elevation + elevation, 0.02), 1.55);
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 2), 150);
  }

  get now() {
    const level = Math.cos(this.elevation);
    const away = [level * Math.cos(this.azimuth), level * Math.sin(this.azimuth), Math.sin(this.elevation)];
    const position = this.aim.map((number, axis) => number + this.distance * away[axis]);
    const forward = unit(minus(this.aim, position));
    const right = unit([forward[1], -forward[0], 0]);
    const R = [...right, ...cross(forward, right), ...forward];
    const t = [0, 3, 6].map((row) => -dot(R.slice(row, row + 3), position));
    return { ...this.camera, R, t };
  }
}
