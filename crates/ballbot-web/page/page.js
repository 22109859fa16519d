// The page: choices, robots, keys, pointer, gamepad.

import * as link from "./link.js";
import { Plot } from "./plots.js";
import { Simulator } from "./simulator.js";
import { View } from "./view.js";

const DEFAULTS = {
  robot: "paper", controller: "lqr", compare: "none", terrain: "level", model: "contact", robots: 1, course: "none",
  speed: 1, follow: false, panel: true, sliders: {}, camera: [0, 0, 0],
};

/** Sliders: factors on parameters, or metres added to one of their numbers. */
const SLIDERS = {
  wheels: { label: "Wheel friction ×", low: 0, high: 2, neutral: 1, of: ["wheel_static_friction", "wheel_dynamic_friction"] },
  floor: { label: "Floor friction ×", low: 0, high: 2, neutral: 1, of: ["floor_static_friction", "floor_dynamic_friction"] },
  mass: { label: "Body mass ×", low: 0.2, high: 3, neutral: 1, of: ["body_mass", "body_inertia", "body_products_of_inertia"] },
  height: { label: "CoM height ×", low: 0.6, high: 1.6, neutral: 1, of: ["body_com_height"] },
  comX: { label: "CoM x, mm", low: -30, high: 30, neutral: 0, offset: ["body_com_offset", 0] },
  comY: { label: "CoM y, mm", low: -30, high: 30, neutral: 0, offset: ["body_com_offset", 1] },
};
for (const [name, { neutral }] of Object.entries(SLIDERS)) DEFAULTS.sliders[name] = neutral;

const SIZE = { size_x: 20, size_y: 20 };
const TERRAINS = {
  level: null, plane: { slope: 0.08 }, wave: { slope: 0.12, ...SIZE }, noise: { slope: 0.12, ...SIZE },
  bumps: { slope: 0.12, ...SIZE }, cobbles: {},
};
const SELECTS = ["robot", "controller", "compare", "terrain", "model", "robots"];
const COUNTS = [1, 4, 16, 64];
const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2];
const KEYS = {
  KeyW: [1, 0, 0], ArrowUp: [1, 0, 0], KeyS: [-1, 0, 0], ArrowDown: [-1, 0, 0], KeyA: [0, 1, 0], ArrowLeft: [0, 1, 0],
  KeyD: [0, -1, 0], ArrowRight: [0, -1, 0], KeyQ: [0, 0, 1], KeyE: [0, 0, -1],
};

/** Longest simulated time of a picture, s: a slow machine shows slow motion. */
const LONGEST = 0.05;

/** Stiffness of a pull, weights per metre of its length in robot heights. */
const PULL = 0.6;

const find = (id) => document.getElementById(id);

function complain(text) {
  const message = find("message");
  message.classList.remove("waiting");
  message.textContent = text;
  message.hidden = !text;
}

class Page {
  constructor(simulator, looks) {
    Object.assign(this, { simulator, keys: new Set(), paused: false, debt: 0, driven: "" });
    const { choices, unknown } = link.read(location.hash, DEFAULTS);
    this.choices = choices;
    this.unknown = unknown;
    // A scene within a page has no controls, but a link to the whole.
    document.body.classList.toggle("bare", !this.choices.panel);
    if (!this.choices.panel) find("whole").href = location.pathname + link.write({ ...this.choices, panel: true }, DEFAULTS);
    this.view = new View(find("scene"), looks);
    this.fill();
    this.listen();
    const number = (name, i) => this.scene.part(0, name)[i];
    const three = (name) => () => [...this.scene.part(0, name)];
    const parent = find("plots");
    this.plots = [
      new Plot(parent, "Tilt, deg", ["the robot", "compared"], () => [
        (number("tilt", 0) * 180) / Math.PI, ...(this.ghost ? [(this.ghost.part(0, "tilt")[0] * 180) / Math.PI] : []),
      ]),
      new Plot(parent, "Wheel torques, N·m", ["1", "2", "3"], three("wheel_torques")),
      new Plot(parent, "Wheel loads, N", ["1", "2", "3"], three("wheel_normal_forces")),
      new Plot(parent, "Traction / friction limit", ["1", "2", "3"], () => {
        const loads = this.scene.part(0, "wheel_normal_forces");
        return [...this.scene.part(0, "wheel_tractions")].map((t, i) => Math.abs(t) / Math.max(1e-9, this.friction * loads[i]));
      }),
    ];
    this.open();
    if (this.unknown.length) this.complain(`The link has ${this.unknown.join(", ")}, which is no choice here.`);
    if (this.choices.camera.some((x) => x !== 0)) this.view.camera.position.fromArray(this.choices.camera);
    this.last = performance.now();
    // A scene that is scrolled out of sight rests.
    new IntersectionObserver((entries) => {
      const { isIntersecting } = entries.at(-1);
      this.last = performance.now();
      this.view.renderer.setAnimationLoop(isIntersecting ? (now) => this.picture(now) : null);
    }).observe(find("scene"));
    // A scene within a page leaves the keys and the wheel to the page.
    if (this.choices.panel) find("scene").focus({ preventScroll: true });
    else this.view.controls.enableZoom = false;
  }

  /** Options of the controls, as the simulator has them. */
  fill() {
    const { controllers: laws, robots, terrains } = this.simulator.catalog;
    const options = (id, items) => {
      find(id).replaceChildren(...items.map(([value, text]) => new Option(text, value)));
      const known = items.some(([value]) => `${value}` === `${this.choices[id]}`);
      if (known) return;
      this.unknown.push(`${id} = ${this.choices[id]}`);
      this.choices[id] = DEFAULTS[id];
    };
    options("robot", Object.keys(robots).map((name) => [name, name]));
    const controllers = [...laws.map(({ name, label }) => [name, label]), ...Object.keys(this.simulator.policies).map((name) => [name, `policy ${name}`])];
    options("controller", controllers);
    options("compare", [["none", "nothing"], ...controllers]);
    options("course", [["none", "by hand"], ...this.simulator.catalog.curves.map((name) => [name, name])]);
    options("terrain", [["level", "level"], ...terrains.filter(({ name }) => TERRAINS[name]).map(({ name }) => [name, name])]);
    options("model", [["contact", "contact and slip"], ["spatial", "without slip"]]);
    options("robots", COUNTS.map((count) => [count, count]));
    options("speed", SPEEDS.map((speed) => [speed, `${speed} ×`]));
    for (const [name, { label, low, high, neutral }] of Object.entries(SLIDERS)) {
      const value = this.choices.sliders[name];
      if (!(value >= low && value <= high)) {
        this.unknown.push(`sliders.${name} = ${value} (${low} to ${high})`);
        this.choices.sliders[name] = neutral;
      }
      const row = document.createElement("label");
      const slider = Object.assign(document.createElement("input"), { type: "range", min: low, max: high, step: "any", id: name });
      const output = document.createElement("output");
      slider.addEventListener("input", () => {
        this.choices.sliders[name] = Number(Number(slider.value).toPrecision(3));
        output.value = this.choices.sliders[name].toPrecision(3);
        this.changeRobots();
      });
      row.append(label, slider, output);
      find("sliders").append(row);
    }
    this.showChoices();
  }

  /** Sets the controls to the choices. */
  showChoices() {
    for (const id of [...SELECTS, "course"]) find(id).value = this.choices[id];
    find("speed").value = this.choices.speed;
    find("follow").checked = this.choices.follow;
    for (const [name, value] of Object.entries(this.choices.sliders)) {
      find(name).value = value;
      find(name).nextElementSibling.value = value.toPrecision(3);
    }
  }

  listen() {
    const focus = () => find("scene").focus({ preventScroll: true });
    addEventListener("hashchange", () => location.reload());
    for (const id of SELECTS) {
      find(id).addEventListener("change", (event) => {
        this.choices[id] = typeof DEFAULTS[id] === "number" ? Number(event.target.value) : event.target.value;
        this.open();
      });
      // Letters choose in a list that has the focus; they are to drive.
      find(id).addEventListener("pointerdown", () => find(id).addEventListener("change", focus, { once: true }));
    }
    find("course").addEventListener("change", (event) => {
      if (event.target.value === "none") this.stop();
      else this.follow(event.target.value);
    });
    find("speed").addEventListener("change", (event) => (this.choices.speed = Number(event.target.value)));
    find("follow").addEventListener("change", (event) => (this.choices.follow = event.target.checked));
    find("push").addEventListener("click", () => this.push());
    find("pause").addEventListener("click", () => this.pause(!this.paused));
    find("reset").addEventListener("click", () => this.reset());
    find("share").addEventListener("click", async () => {
      this.choices.camera = this.view.place;
      history.replaceState(null, "", location.pathname + link.write(this.choices, DEFAULTS));
      try {
        await navigator.clipboard.writeText(location.href);
        find("share").textContent = "Copied";
      } catch {
        find("share").textContent = "In the address";
      }
      setTimeout(() => (find("share").textContent = "Copy link"), 1500);
    });
    const typing = (event) => event.target.matches?.("input, select");
    addEventListener("keydown", (event) => {
      if (typing(event) || event.ctrlKey || event.metaKey || event.altKey) return;
      // In the panel arrows scroll.
      if (event.code.startsWith("Arrow") && find("panel").contains(event.target)) return;
      if (event.code in KEYS) this.keys.add(event.code);
      else if (event.code === "Space" && !event.target.matches("button")) this.attempt(() => this.stop());
      else if (event.code === "KeyP") this.push();
      else return;
      event.preventDefault();
    });
    addEventListener("keyup", (event) => this.keys.delete(event.code));
    addEventListener("blur", () => this.keys.clear());
    const canvas = this.view.renderer.domElement;
    canvas.addEventListener("pointerdown", (event) => this.press(event), { capture: true });
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", (event) => this.isOf(event) && this.letGo());
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.complain("The browser lost the 3D view; the simulation continues.");
    });
    canvas.addEventListener("webglcontextrestored", () => this.complain(""));
  }

  /** Calls a function of all scenes; shows the first error after the last of them. Returns whether there is none. */
  each(name, ...values) {
    return this.every((scene) => scene.call(name, ...values));
  }

  every(act) {
    return this.attempt(() => {
      const errors = [];
      for (const scene of this.scenes()) {
        try {
          act(scene);
        } catch (error) {
          errors.push(`${scene === this.scene ? this.choices.controller : this.choices.compare}: ${error.message}`);
        }
      }
      if (errors.length) throw new Error(errors[0]);
      return true;
    });
  }

  /** Sends the robots along a curve. */
  follow(curve) {
    let follows = false;
    this.every((scene) => {
      scene.follow(curve);
      if (scene === this.scene) follows = true;
    });
    this.setCourse(follows ? curve : "none");
    this.driven = "sent";
  }

  setCourse(course) {
    find("course").value = this.choices.course = course;
  }

  reset() {
    this.each("reset");
    this.setCourse("none");
    this.driven = "";
  }

  /** Runs what may fail, and shows its error. */
  attempt(act) {
    try {
      const done = act();
      this.complain("");
      return done;
    } catch (error) {
      this.complain(error.message);
      return undefined;
    }
  }

  complain(text) {
    complain(text);
  }

  scenes() {
    return this.ghost ? [this.scene, this.ghost] : [this.scene];
  }

  /** Opens the scenes of the choices; those before stay if these fail. */
  open() {
    this.attempt(() => {
      const { robot, controller, compare, terrain, model, robots } = this.choices;
      const ground = TERRAINS[terrain] ? { kind: terrain, ...TERRAINS[terrain] } : { kind: "level" };
      const settings = { robot, controller, model, robots, terrain: ground, tilt: robots > 1 ? 0.12 : 0 };
      const scene = this.simulator.open(settings);
      let ghost;
      try {
        ghost = compare === "none" ? undefined : this.simulator.open({ ...settings, robots: 1, controller: compare });
        for (const one of ghost ? [scene, ghost] : [scene]) one.setParams(this.changes());
      } catch (error) {
        scene.close();
        ghost?.close();
        throw error;
      }
      if (this.scene) this.scenes().forEach((one) => one.close());
      Object.assign(this, { scene, ghost, driven: "" });
      const [radius] = this.simulator.catalog.robots[robot].ball_radius;
      const isOther = this.shown !== `${robot} ${robots}`;
      this.view.show(robot, robots, ghost ? 1 : 0, radius);
      if (isOther) this.view.frame();
      this.shown = `${robot} ${robots}`;
      this.opened = structuredClone(this.choices);
      this.plots.forEach((plot) => plot.clear());
      find("summary").textContent = this.summary(controller);
      this.friction = this.simulator.catalog.robots[robot].wheel_static_friction[0] * this.choices.sliders.wheels;
    });
    const shown = this.opened ?? { ...DEFAULTS, panel: this.choices.panel };
    if (shown !== this.opened || SELECTS.some((id) => this.choices[id] !== shown[id])) {
      // The choices do not fit together: as before, or as at first.
      const reason = find("message").textContent;
      this.choices = { ...structuredClone(shown), course: this.choices.course };
      this.showChoices();
      if (!this.scene) this.open();
      this.complain(reason);
    } else if (this.choices.course !== "none") this.follow(this.choices.course);
  }

  summary(controller) {
    const law = this.simulator.catalog.controllers.find(({ name }) => name === controller);
    if (law) return law.summary;
    const { task, scale_by_robot: any } = this.simulator.policies[controller];
    return `A network trained in the task ${task}, ${any ? "for any robot" : "on the robot paper"}.`;
  }

  /** Parameters that the sliders change. */
  changes() {
    const params = this.simulator.catalog.robots[this.choices.robot];
    const changes = {};
    for (const [name, { of, offset, neutral }] of Object.entries(SLIDERS)) {
      const value = this.choices.sliders[name];
      if (value === neutral) continue;
      for (const param of of ?? []) {
        const values = params[param].map((number) => number * value);
        changes[param] = values.length === 1 ? values[0] : values;
      }
      if (offset) {
        changes[offset[0]] ??= [...params[offset[0]]];
        changes[offset[0]][offset[1]] += value / 1000;
      }
    }
    return changes;
  }

  changeRobots() {
    this.attempt(() => {
      this.scenes().forEach((scene) => scene.setParams(this.changes()));
      const [friction] = this.simulator.catalog.robots[this.choices.robot].wheel_static_friction;
      this.friction = friction * this.choices.sliders.wheels;
    });
  }

  pause(paused) {
    this.paused = paused;
    find("pause").textContent = paused ? "Continue" : "Pause";
    find("pause").setAttribute("aria-pressed", paused);
  }

  /** Pushes a robot sideways or along a direction, by half of what its traction may catch. */
  push(direction = [Math.random() - 0.5, Math.random() - 0.5], robot = 0) {
    const { ball_mass, body_mass, body_com_height, gravity } = this.simulator.catalog.robots[this.choices.robot];
    const impulse = 0.06 * (ball_mass[0] + body_mass[0]) * Math.sqrt(gravity[0] * body_com_height[0]);
    const [x, y] = direction.map((part) => (impulse * part) / Math.hypot(...direction));
    this.attempt(() => {
      this.scene.call("push", robot, x, y, 0);
      if (robot === 0) this.ghost?.call("push", 0, x, y, 0);
    });
    const [bodyX, bodyY, bodyZ] = this.scene.part(robot, "body_position");
    this.view.showPush(x, y, [bodyX, bodyY, bodyZ + 0.3 * this.view.height]);
  }

  stop() {
    this.keys.clear();
    this.setCourse("none");
    this.each("drive", 0, 0, 0);
  }

  press(event) {
    // A second finger turns the camera.
    if (event.button !== 0 || this.pressed) return;
    const hit = this.view.robotAt(event);
    this.pressed = { pointer: event.pointerId, x: event.clientX, y: event.clientY, hit, moved: false };
    if (hit) {
      event.stopImmediatePropagation();
      event.target.setPointerCapture(event.pointerId);
    }
  }

  move(event) {
    const { pressed } = this;
    if (!this.isOf(event)) return;
    pressed.moved ||= Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) > 6;
    if (!pressed.hit || !pressed.moved) return;
    const body = this.scene.part(pressed.hit.index, "body_position");
    const from = [body[0], body[1], body[2] + 0.3 * this.view.height];
    const to = this.view.beside(event, from);
    if (!to) return;
    const { ball_mass, body_mass, gravity } = this.simulator.catalog.robots[this.choices.robot];
    const stiffness = (PULL * gravity[0] * (ball_mass[0] + body_mass[0])) / this.view.height;
    const force = [to.x - from[0], to.y - from[1], 0].map((part) => part * stiffness);
    this.attempt(() => {
      this.scene.call("pull", pressed.hit.index, ...force);
      if (pressed.hit.index === 0) this.ghost?.call("pull", 0, ...force);
    });
  }

  release(event) {
    const { pressed } = this;
    if (!this.isOf(event)) return;
    this.letGo();
    if (pressed.moved) return;
    if (pressed.hit) {
      // Away from the camera.
      const { x, y } = pressed.hit.point.clone().sub(this.view.camera.position);
      this.push([x, y], pressed.hit.index);
    } else {
      const place = this.view.floorAt(event);
      if (!place) return;
      this.each("go_to", place.x, place.y);
      this.setCourse("none");
      // A key that is let go later does not stop it.
      this.driven = "sent";
    }
  }

  /** Whether an event is of the pointer that is pressed. */
  isOf(event) {
    return this.pressed?.pointer === event.pointerId;
  }

  letGo() {
    const hit = this.pressed?.hit;
    this.pressed = undefined;
    if (!hit) return;
    this.attempt(() => {
      this.scene.call("pull", hit.index, 0, 0, 0);
      if (hit.index === 0) this.ghost?.call("pull", 0, 0, 0, 0);
    });
  }

  /** Drives by keys or gamepad; calls nothing while they do not change. */
  steer() {
    const sums = [...this.keys].reduce((sum, key) => sum.map((part, i) => part + KEYS[key][i]), [0, 0, 0]);
    let wanted = sums.map((part) => Math.min(1, Math.max(-1, part)));
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (pad?.mapping !== "standard") continue;
      const axes = [-pad.axes[1], -pad.axes[0], -pad.axes[2]].map((value) => (Math.abs(value) < 0.12 ? 0 : value));
      if (axes.some((value) => value !== 0)) wanted = axes.map((value) => Math.min(1, Math.max(-1, value)));
    }
    const now = `${wanted}`;
    const isIdle = wanted.every((part) => part === 0);
    if (now === this.driven || (["", "sent"].includes(this.driven) && (isIdle || now === this.held))) return;
    this.held = this.driven = now;
    this.setCourse("none");
    this.each("drive", ...wanted);
  }

  picture(now) {
    // The time of a picture may be before the time at which the page was made.
    const passed = Math.min(LONGEST, Math.max(0, (now - this.last) / 1000));
    this.last = now;
    this.attemptQuietly(() => {
      this.steer();
      if (!this.paused) {
        this.debt += 1000 * passed * this.choices.speed;
        const steps = Math.floor(this.debt);
        this.debt -= steps;
        if (steps) {
          this.scenes().forEach((scene) => scene.advance(steps));
          this.plots.forEach((plot) => plot.add(this.scene.time));
        }
      }
      this.view.showGround(this.scene, this.choices.terrain !== "level");
      this.view.update(this.scene, this.ghost, this.choices.follow);
      this.plots.forEach((plot) => plot.draw());
      this.numbers();
    });
  }

  attemptQuietly(act) {
    try {
      act();
    } catch (error) {
      this.complain(error.message);
      this.pause(true);
    }
  }

  numbers() {
    const part = (scene, name) => scene.part(0, name);
    const line = (scene, name) => {
      const [x, y] = part(scene, "ball_position");
      const tilt = (part(scene, "tilt")[0] * 180) / Math.PI;
      const speed = Math.hypot(...part(scene, "ball_velocity"));
      const fallen = part(scene, "fallen")[0] ? "  fallen" : "";
      return `${name}: tilt ${tilt.toFixed(1)}°  speed ${speed.toFixed(2)} m/s  at (${x.toFixed(2)}, ${y.toFixed(2)}) m${fallen}`;
    };
    const lines = [`${this.scene.time.toFixed(1)} s`, line(this.scene, this.choices.controller)];
    if (this.ghost) lines.push(line(this.ghost, this.choices.compare));
    find("numbers").textContent = lines.join("\n");
  }
}

try {
  complain("");
  const get = async (name) => {
    const answer = await fetch(name);
    if (!answer.ok) throw new Error(`${answer.url}: ${answer.status} ${answer.statusText}`);
    return answer;
  };
  const json = (name) => get(name).then((answer) => answer.json());
  const [module, policies, looks] = await Promise.all([get("ballbot.wasm"), json("policies.json"), json("looks.json")]);
  const simulator = await Simulator.load(module, policies);
  globalThis.ballbot = new Page(simulator, looks);
} catch (error) {
  complain(`The simulator does not start: ${error.message}`);
}
