// What all canvases share: colours of the reader's light or dark, sharp pixels, and small marks.

let found = null;

const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => { found = null; });
export const onTheme = (call) => dark.addEventListener("change", call);

// The value of a CSS variable.
export function colour(name) {
  found ??= getComputedStyle(document.documentElement);
  return found.getPropertyValue(name).trim();
}

// A context whose units are CSS pixels, cleared; with width and height.
export function begin(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  const [wide, high] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.lineJoin = context.lineCap = "round";
  return { context, width, height };
}

// Where an event is on its canvas, CSS pixels.
export function placeOf(event) {
  const box = event.currentTarget.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

export function diamond(context, x, y, size) {
  context.beginPath();
  context.moveTo(x, y - size);
  context.lineTo(x + size, y);
  context.lineTo(x, y + size);
  context.lineTo(x - size, y);
  context.closePath();
}

export function disc(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
}

// A label with a plate behind it, that stays readable on anything.
export function plate(context, text, x, y, ink) {
  context.font = "600 12px system-ui, sans-serif";
  const width = context.measureText(text).width + 10;
  context.fillStyle = colour("--card");
  context.globalAlpha = 0.82;
  context.beginPath();
  context.roundRect(x - width / 2, y - 9, width, 18, 5);
  context.fill();
  context.globalAlpha = 1;
  context.fillStyle = ink;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, x, y + 0.5);
}
