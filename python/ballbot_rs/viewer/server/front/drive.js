// Keyboard and gamepad of the page, sent to the server while they drive: [forward, left, turn], shares in [-1, 1].
// The same connection reports the system's color scheme, and the key of the camera.
(() => {
  "use strict";
  const PERIOD = 100; // ms; the server stops the robot when nothing has come for some of these
  const DEAD_ZONE = 0.12; // of a stick, which does not return to 0 exactly
  const KEYS = {
    KeyW: [1, 0, 0], ArrowUp: [1, 0, 0], KeyS: [-1, 0, 0], ArrowDown: [-1, 0, 0],
    KeyA: [0, 1, 0], ArrowLeft: [0, 1, 0], KeyD: [0, -1, 0], ArrowRight: [0, -1, 0],
    KeyQ: [0, 0, 1], KeyE: [0, 0, -1],
  };
  const pressed = new Set();
  let socket = null;
  let drives = false; // whether the server takes commands now
  let moving = false; // whether the last command was not zero
  let waits = false; // for the sticks to return to the middle, after a stop

  const clamp = (value) => Math.max(-1, Math.min(1, value));
  const stick = (value) =>
    Math.abs(value) <= DEAD_ZONE ? 0 : clamp((Math.abs(value) - DEAD_ZONE) / (1 - DEAD_ZONE)) * Math.sign(value);

  function sticks() {
    const sum = [0, 0, 0];
    for (const pad of navigator.getGamepads ? navigator.getGamepads() : []) {
      // Of other mappings an axis may be a trigger, which rests at its end.
      if (!pad || !pad.connected || pad.mapping !== "standard" || pad.axes.length < 3) continue;
      [pad.axes[1], pad.axes[0], pad.axes[2]].forEach((axis, i) => { sum[i] -= stick(axis); });
    }
    return sum;
  }

  function commanded() {
    const sum = sticks();
    if (sum.every((share) => share === 0)) waits = false;
    if (waits) sum.fill(0);
    for (const code of pressed) KEYS[code].forEach((share, i) => { sum[i] += share; });
    return sum.map(clamp);
  }

  function send(command) {
    moving = command.some((share) => share !== 0);
    if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
  }

  function update() {
    if (!drives || !document.hasFocus()) return;
    const command = commanded();
    if (moving || command.some((share) => share !== 0)) send(command);
  }

  function stop() {
    pressed.clear();
    waits = true;
    if (drives) send([0, 0, 0]);
  }

  // A stop when nothing moves would take the command from the task.
  function letGo() {
    if (moving || pressed.size) stop();
  }

  function types(event) {
    const field = event.target instanceof Element && event.target.closest("input, textarea, select, [role=slider]");
    return Boolean(field) && field.type !== "checkbox";
  }

  function take(event) {
    event.preventDefault();
    // The page's own keys move the camera.
    event.stopImmediatePropagation();
  }

  function report(message) {
    if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  }
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", () => report({ dark: dark.matches }));

  window.addEventListener("keydown", (event) => {
    if (event.code === "KeyC" && !event.repeat && !types(event) && !event.ctrlKey && !event.metaKey) report({ chase: true });
    if (!drives || types(event) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.code === "Space") {
      take(event);
      if (!event.repeat) stop();
    } else if (event.code in KEYS) {
      take(event);
      if (event.repeat) return;
      pressed.add(event.code);
      update();
    }
  }, true);
  window.addEventListener("keyup", (event) => {
    if (drives && event.code === "Space" && !types(event)) take(event);
    if (!pressed.delete(event.code)) return;
    take(event);
    update();
  }, true);
  for (const name of ["blur", "pagehide"]) window.addEventListener(name, letGo);
  document.addEventListener("visibilitychange", () => { if (document.hidden) letGo(); });
  // A click on the scene takes the focus from a field, so that keys drive.
  window.addEventListener("pointerdown", (event) => {
    if (event.target instanceof HTMLCanvasElement && document.activeElement) document.activeElement.blur();
  }, true);

  function connect() {
    socket = new WebSocket(location.origin.replace(/^http/, "ws") + "/drive");
    socket.onopen = () => report({ dark: dark.matches });
    socket.onmessage = (message) => {
      drives = message.data === "on";
      if (!drives) { pressed.clear(); moving = false; }
    };
    socket.onclose = () => {
      drives = moving = false;
      pressed.clear();
      setTimeout(connect, 1000);
    };
  }
  connect();
  setInterval(update, PERIOD);
})();
