// How many robots the module simulates in real time: node speed.mjs MODULE.

import { readFileSync } from "node:fs";
import { Simulator } from "./page/simulator.js";

const STEPS = 20_000;

const simulator = await Simulator.load(readFileSync(process.argv[2]));
for (const [model, controller, robots] of [
  ["contact", "lqr", 1], ["contact", "cascade_pid", 1], ["contact", "lqr", 64], ["spatial", "lqr", 1],
]) {
  const scene = simulator.open({ model, controller, robots, tilt: 0.1 });
  scene.advance(2000);
  const steps = Math.round(STEPS / robots);
  const begin = performance.now();
  scene.advance(steps);
  console.log(`${model}, ${controller}, ${robots}: ${((steps * robots) / (performance.now() - begin)).toFixed(0)}`);
  scene.close();
}
