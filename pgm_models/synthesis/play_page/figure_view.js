// The scene from a camera: court, players as figures, the ball; under them the rendered picture where there is one.

import { Orbit, cameraOf, inFront, sized, toCamera, toPixel } from "./camera.js";
import { begin, colour, disc } from "./drawing.js";

const LIMB_M = 0.13;
const HEAD_M = 0.13;
const LEAST_BALL_PX = 3;

export class FigureView {
  // `look` is called where the camera changes.
  constructor(canvas, stage, look) {
    Object.assign(this, { canvas, stage, look, orbit: null, cameras: stage.camera, version: 0, held: null });
    canvas.addEventListener("pointerdown", (event) => this.grab(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { this.held = null; });
    canvas.addEventListener("wheel", (event) => this.zoom(event), { passive: false });
    canvas.addEventListener("dblclick", () => this.usual());
  }

  // Take the rally's own cameras.
  follow(cameras) {
    this.cameras = cameras ?? this.stage.camera;
    this.version += 1;
  }

  usual() {
    this.orbit = null;
    this.version += 1;
    this.look();
  }

  // The camera of a frame, in its own size.
  camera(frame) {
    return this.orbit ? this.orbit.now : cameraOf(this.cameras, frame);
  }

  grab(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.held = [event.clientX, event.clientY];
  }

  own() {
    this.orbit ??= new Orbit(cameraOf(this.cameras, this.frame ?? 0), 0);
    this.version += 1;
    return this.orbit;
  }

  move(event) {
    if (!this.held) return;
    const [x, y] = this.held;
    if (event.clientX === x && event.clientY === y) return;
    this.held = [event.clientX, event.clientY];
    this.own().turn((x - event.clientX) * 0.007, (event.clientY - y) * 0.005);
    this.look();
  }

  zoom(event) {
    event.preventDefault();
    this.own().zoom(Math.exp(event.deltaY * 0.001));
    this.look();
  }

  // Draw a frame; over a picture of it where there is one, and then nothing else.
  draw(shown, picture) {
    this.frame = shown.frame;
    const { context, width, height } = begin(this.canvas);
    context.fillStyle = colour("--sky");
    context.fillRect(0, 0, width, height);
    if (picture) {
      const scale = Math.min(width / picture.width, height / picture.height);
      const [wide, high] = [scale * picture.width, scale * picture.height];
      context.imageSmoothingQuality = "high";
      context.drawImage(picture, (width - wide) / 2, (height - high) / 2, wide, high);
      return;
    }
    const camera = sized(this.camera(shown.frame), width, height);
    this.ground(context, camera);
    const items = this.stage.players.map((player) => this.figure(context, camera, player, shown.players[player.number]));
    items.push(this.net(context, camera), this.ball(context, camera, shown.ball));
    for (const item of items.filter(Boolean).sort((a, b) => b.depth - a.depth)) item.paint();
  }

  area(context, camera, points, style) {
    const seen = inFront(camera, points, true).map((point) => toPixel(camera, point));
    if (seen.length < 3) return;
    context.beginPath();
    seen.forEach((pixel, number) => context[number ? "lineTo" : "moveTo"](...pixel));
    context.closePath();
    context.fillStyle = style;
    context.fill();
  }

  line(context, camera, points) {
    const seen = inFront(camera, points, false).map((point) => toPixel(camera, point));
    if (seen.length < 2) return;
    context.beginPath();
    seen.forEach((pixel, number) => context[number ? "lineTo" : "moveTo"](...pixel));
    context.stroke();
  }

  ground(context, camera) {
    const { stage } = this;
    const [[x0, y0], [x1, y1]] = stage.area;
    const [mx, my] = stage.surface ? [(x1 - x0) / 2, (y1 - y0) / 4] : [0, 0];
    const rectangle = (a, b, c, d) => [[a, b, 0], [c, b, 0], [c, d, 0], [a, d, 0]];
    this.area(context, camera, rectangle(x0 - mx, y0 - my, x1 + mx, y1 + my), colour("--apron"));
    if (stage.surface) {
      const [half, long] = stage.surface;
      this.area(context, camera, rectangle(-half, -long, half, long), colour("--court"));
    } else {
      context.strokeStyle = colour("--grid");
      context.lineWidth = 1;
      for (let x = Math.ceil(x0); x <= x1; x += 1) this.line(context, camera, [[x, y0, 0], [x, y1, 0]]);
      for (let y = Math.ceil(y0); y <= y1; y += 1) this.line(context, camera, [[x0, y, 0], [x1, y, 0]]);
    }
    for (const { ends, width } of stage.lines) {
      const [[ax, ay, az], [bx, by, bz]] = ends;
      const long = Math.hypot(bx - ax, by - ay);
      const [nx, ny] = [(ay - by) / long * width / 2, (bx - ax) / long * width / 2];
      const corners = [[ax + nx, ay + ny, az], [bx + nx, by + ny, bz], [bx - nx, by - ny, bz], [ax - nx, ay - ny, az]];
      this.area(context, camera, corners, colour("--paint"));
    }
  }

  net(context, camera) {
    const top = this.stage.net;
    if (top.length < 2) return null;
    const paint = () => {
      const foot = [...top].reverse().map(([x, y]) => [x, y, 0]);
      context.globalAlpha = 0.35;
      this.area(context, camera, [...top, ...foot], colour("--net"));
      context.globalAlpha = 1;
      context.strokeStyle = colour("--paint");
      context.lineWidth = 2;
      this.line(context, camera, top);
    };
    return { depth: toCamera(camera, top[Math.floor(top.length / 2)])[2], paint };
  }

  shadow(context, camera, [x, y], radius) {
    const ring = Array.from({ length: 20 }, (_, step) => {
      const angle = step / 20 * 2 * Math.PI;
      return [x + radius * Math.cos(angle), y + radius * Math.sin(angle), 0];
    });
    this.area(context, camera, ring, colour("--shadow"));
  }

  figure(context, camera, player, pose) {
    if (!pose.root) return null;
    const colours = ["--one", "--two", "--three", "--four"];
    const ink = colour(colours[player.number % colours.length]);
    const depth = toCamera(camera, pose.root)[2];
    if (depth < 0.3) return null;
    const paint = () => {
      this.shadow(context, camera, pose.root, 0.38);
      const limbs = [];
      let head;
      if (pose.joints) {
        const joint = (number) => pose.joints.slice(3 * number, 3 * number + 3);
        player.parents.forEach((parent, number) => { if (parent >= 0) limbs.push([joint(parent), joint(number)]); });
        if (player.head >= 0) head = joint(player.head);
      } else {
        const [x, y, z] = pose.root;
        limbs.push([[x, y, 0.1], [x, y, z + 0.5]]);
        head = [x, y, z + 0.75];
      }
      context.strokeStyle = context.fillStyle = ink;
      context.globalAlpha = pose.wished ? 0.55 : 1;
      context.lineWidth = Math.max(1.5, LIMB_M * camera.K[0] / depth);
      for (const limb of limbs) this.line(context, camera, limb);
      if (head) {
        disc(context, ...toPixel(camera, toCamera(camera, head)), Math.max(2, HEAD_M * camera.K[0] / depth));
        context.fill();
      }
      context.globalAlpha = 1;
    };
    return { depth, paint };
  }

  ball(context, camera, ball) {
    if (!ball) return null;
    const seen = toCamera(camera, ball.place);
    if (seen[2] < 0.2) return null;
    const paint = () => {
      this.shadow(context, camera, ball.place, Math.max(2 * this.stage.ball.radius, 0.07));
      disc(context, ...toPixel(camera, seen), Math.max(LEAST_BALL_PX, this.stage.ball.radius * camera.K[0] / seen[2]));
      context.fillStyle = colour("--ball");
      context.strokeStyle = colour("--ballrim");
      context.lineWidth = 1;
      context.fill();
      context.stroke();
    };
    return { depth: seen[2], paint };
  }
}
