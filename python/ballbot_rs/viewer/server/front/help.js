// The help: what keys, gamepad and mouse do. The button in the status opens it, and the key "?" or F1.
(() => {
  "use strict";
  const rows = (pairs) => pairs.map(([keys, text]) => `<dt>${keys}</dt><dd>${text}</dd>`).join("");
  const key = (...names) => names.map((name) => `<kbd>${name}</kbd>`).join(" ");
  const CONTENT = `
    <form method="dialog"><button aria-label="Close">×</button></form>
    <h2>Mouse</h2><dl>${rows([
      ["Click on the floor", "the robot goes there, in the tasks balance and goal"],
      ["Drag the robot", "pulls it, with at most a fifth of its weight"],
      ["Drag elsewhere, wheel", "turns and zooms the view; with the right button: moves it"],
    ])}</dl>
    <h2>Driving, in the tasks velocity and terrain</h2><dl>${rows([
      [`${key("W", "A", "S", "D")} or arrows`, "drives along the heading, which the violet marks show"],
      [key("Q", "E"), "turns left, right"],
      [key("Space"), "stops"],
      [key("C"), "camera behind the robot, and back"],
      ["Gamepad", "left stick drives, right stick turns"],
    ])}</dl>
    <h2>Page</h2><dl>${rows([
      [`${key("?")} ${key("F1")}`, "this help"],
      ["Transparent robot", "the robot to compare with (tab Robot): its numbers are in the right column"],
      ["Arrows at the robot", "pushes red; forces (tab View): loads blue, tractions green, force along the ground red"],
    ])}</dl>
    <p>In an input field keys are text: click on the scene first. <a href="/docs/view.md" target="_blank">Documentation
    of the page</a></p>`;
  let dialog = null;

  function toggle() {
    if (!dialog) {
      dialog = document.createElement("dialog");
      dialog.className = "ballbot-help";
      dialog.innerHTML = CONTENT;
      // A click beside it closes it.
      dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
      document.body.append(dialog);
    }
    if (dialog.open) dialog.close(); else dialog.showModal();
  }

  document.addEventListener("click", (event) => {
    if (event.target instanceof Element && event.target.closest('[data-ballbot="help"]')) toggle();
  });
  window.addEventListener("keydown", (event) => {
    const types = event.target instanceof Element && event.target.closest("input:not([type=checkbox]), textarea");
    if (types || (event.key !== "?" && event.key !== "F1")) return;
    event.preventDefault();
    toggle();
  });
})();
