// Curves of the last seconds.

const SECONDS = 10;
const COLORS = ["#2f6fdb", "#2a9d5c", "#d9822b", "#8b5cf6"];

export class Plot {
  /** A plot of some curves; `sample` returns their values now. */
  constructor(parent, title, names, sample) {
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    caption.append(title, " ");
    names.forEach((name, i) => {
      const entry = document.createElement("span");
      entry.style.color = COLORS[i];
      entry.textContent = `${name} `;
      caption.append(entry);
    });
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${title} over the last ${SECONDS} s`);
    figure.append(caption, this.canvas);
    parent.append(figure);
    Object.assign(this, { sample, times: [], values: [] });
  }

  clear() {
    this.times = [];
    this.values = [];
  }

  add(time) {
    // The robots have begun again.
    if (time < this.times.at(-1)) this.clear();
    this.times.push(time);
    this.values.push(this.sample());
    const first = this.times.findIndex((t) => t > time - SECONDS);
    this.times.splice(0, first);
    this.values.splice(0, first);
  }

  draw() {
    const { canvas } = this;
    const ratio = devicePixelRatio;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
    if (!width || !this.times.length) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    const all = this.values.flat();
    const low = Math.min(0, ...all);
    const high = Math.max(low + 1e-9, ...all);
    const end = this.times.at(-1);
    const x = (time) => width * (1 - (end - time) / SECONDS);
    const y = (value) => height * (0.95 - (0.9 * (value - low)) / (high - low));
    const text = getComputedStyle(canvas).color;
    context.strokeStyle = context.fillStyle = text;
    context.globalAlpha = 0.3;
    context.beginPath();
    context.moveTo(0, y(0));
    context.lineTo(width, y(0));
    context.stroke();
    context.globalAlpha = 1;
    context.lineWidth = 1.5 * ratio;
    for (let i = 0; i < this.values[0].length; i++) {
      context.strokeStyle = COLORS[i];
      context.beginPath();
      this.times.forEach((time, k) => context.lineTo(x(time), y(this.values[k][i])));
      context.stroke();
    }
    context.font = `${11 * ratio}px system-ui`;
    context.fillText(high.toPrecision(3), 4 * ratio, 12 * ratio);
    context.fillText(low.toPrecision(3), 4 * ratio, height - 4 * ratio);
  }
}
