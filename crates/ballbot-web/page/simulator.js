// The simulator in WebAssembly: texts, scenes and their rows.

const encoder = new TextEncoder();
const decoder = new TextDecoder();

/** Most steps of a call, which nothing interrupts. */
const MOST_STEPS = 100_000;

export class Simulator {
  /** Instantiates the module of a response or of bytes. */
  static async load(source, policies = {}) {
    // Some servers have no type for WebAssembly, so it is not compiled while it streams.
    const bytes = source instanceof Response ? await source.arrayBuffer() : source;
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Simulator(instance.exports, policies);
  }

  /** `policies`: settings of policies by name, which are then controllers. */
  constructor(exports, policies) {
    Object.assign(this, { exports, policies });
    this.check(exports.describe());
    this.catalog = { controllers: [], terrains: [], curves: [], robots: {}, row: {}, width: 0 };
    for (const line of this.output().trim().split("\n")) {
      const [kind, name, ...rest] = line.split("\t");
      if (kind === "row") {
        this.catalog.row[name] = [this.catalog.width, this.catalog.width + Number(rest[0])];
        this.catalog.width += Number(rest[0]);
      } else if (kind === "controller") this.catalog.controllers.push({ name, label: rest[0], summary: rest[1] });
      else if (kind === "curve") this.catalog.curves.push(name);
      else if (kind === "terrain") this.catalog.terrains.push({ name, summary: rest[0] });
      else if (kind === "robot") {
        this.catalog.robots[name] = Object.fromEntries(
          rest[0].split(" ").map((item) => item.split("=")).map(([key, values]) => [key, values.split(",").map(Number)]),
        );
      }
    }
  }

  output() {
    const { memory, output, output_len } = this.exports;
    return decoder.decode(new Uint8Array(memory.buffer, output(), output_len()));
  }

  check(result) {
    if (result < 0) throw new Error(this.output());
    return result;
  }

  give(text) {
    const bytes = encoder.encode(text);
    const place = this.exports.input(bytes.length);
    if (place === 0) throw new Error(`a text of ${bytes.length} bytes is too long`);
    new Uint8Array(this.exports.memory.buffer, place, bytes.length).set(bytes);
  }

  /** Opens a scene; the tables of the settings become tables of TOML. */
  open(settings) {
    const { controller, ...rest } = settings;
    this.give(toml(Object.hasOwn(this.policies, controller) ? { ...rest, policy: this.policies[controller] } : settings));
    return new Scene(this, this.check(this.exports.open_scene()), settings.robots ?? 1);
  }
}

export class Scene {
  constructor(simulator, number, robots) {
    Object.assign(this, { simulator, number, robots });
  }

  call(name, ...values) {
    return this.simulator.check(this.simulator.exports[name](this.number, ...values));
  }

  /** Advances by steps of 1 ms. */
  advance(steps) {
    if (!Number.isInteger(steps) || steps < 0 || steps > MOST_STEPS) {
      throw new Error(`steps = ${steps}: must be a whole number from 0 to ${MOST_STEPS}`);
    }
    this.call("advance", steps);
  }

  get time() {
    return this.simulator.exports.time(this.number);
  }

  /** A part of a robot's row. The memory of the module may have moved since the last call. */
  part(robot, name) {
    const { row, width } = this.simulator.catalog;
    if (!row[name]) throw new Error(`a row has no part ${name}: it has ${Object.keys(row).join(", ")}`);
    if (!(robot >= 0 && robot < this.robots)) throw new Error(`robot = ${robot}: must be below ${this.robots}`);
    const [from, to] = row[name];
    const { rows, memory } = this.simulator.exports;
    return new Float64Array(memory.buffer, this.opened(rows(this.number)) + 8 * (robot * width + from), to - from);
  }

  /** Heights of the ground at the nodes of a square grid. */
  heights(x, y, half, count) {
    if (!(count >= 2 && count <= 1000)) throw new Error(`count = ${count}: must be from 2 to 1000`);
    const { heights } = this.simulator.exports;
    const place = this.opened(heights(this.number, x, y, half, count));
    return new Float64Array(this.simulator.exports.memory.buffer, place, count * count);
  }

  /** Rows of the obstacles: x, y, top, angle, length, width, radius. */
  obstacles() {
    const { obstacles, obstacle_count: count, memory } = this.simulator.exports;
    const place = this.opened(obstacles(this.number));
    const numbers = new Float64Array(memory.buffer, place, 7 * count(this.number));
    return Array.from({ length: numbers.length / 7 }, (_, i) => numbers.slice(7 * i, 7 * i + 7));
  }

  /** A place in memory, unless it is null. */
  opened(place) {
    if (place === 0) throw new Error("the scene is closed");
    return place;
  }

  /** Moves the target along a curve. */
  follow(curve) {
    this.simulator.give(curve);
    this.call("follow");
  }

  setParams(changes) {
    this.simulator.give(toml(changes));
    this.call("set_params");
  }

  close() {
    this.simulator.exports.close_scene(this.number);
    // Another scene may get its number.
    this.number = 2 ** 31 - 1;
  }
}

/** Names, numbers, arrays of numbers, and tables of these, as TOML. */
export function toml(values) {
  const entries = Object.entries(values);
  const isTable = (value) => typeof value === "object" && !Array.isArray(value);
  const line = ([name, value]) => `${JSON.stringify(name)} = ${JSON.stringify(value)}`;
  return [
    ...entries.filter(([, value]) => !isTable(value)).map(line),
    ...entries.filter(([, value]) => isTable(value)).flatMap(([name, table]) => [`[${JSON.stringify(name)}]`, toml(table)]),
  ].join("\n");
}
