// What a user takes away, or brings: a picture of the scene, a link to the present choice, and the choice of a link.
(() => {
  "use strict";
  // A picture is taken between two frames, when the browser has emptied the buffer otherwise.
  const getContext = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    const kept = /^webgl/.test(kind) ? { ...options, preserveDrawingBuffer: true } : options;
    return getContext.call(this, kind, kept);
  };

  function screenshot() {
    const scene = document.querySelector("canvas[data-engine]");
    if (!scene) return;
    const picture = document.createElement("canvas");
    picture.width = scene.width;
    picture.height = scene.height;
    const context = picture.getContext("2d");
    // The sky, which is behind the scene, is the style sheet's.
    const sky = context.createLinearGradient(0, 0, 0, 0.55 * scene.height);
    const style = getComputedStyle(document.documentElement);
    sky.addColorStop(0, style.getPropertyValue("--sky"));
    sky.addColorStop(1, style.getPropertyValue("--floor"));
    context.fillStyle = sky;
    context.fillRect(0, 0, scene.width, scene.height);
    context.drawImage(scene, 0, 0);
    picture.toBlob((blob) => {
      const anchor = document.createElement("a");
      anchor.href = URL.createObjectURL(blob);
      anchor.download = "ballbot.png";
      anchor.click();
      setTimeout(() => URL.revokeObjectURL(anchor.href), 1000);
    });
  }

  async function link(button) {
    const address = `${location.origin}/?${button.dataset.query}`;
    try {
      await navigator.clipboard.writeText(address);
      button.textContent = "Copied";
    } catch {
      window.prompt("Link", address);
    }
    setTimeout(() => { button.textContent = "Copy link"; }, 1500);
  }

  document.addEventListener("click", (event) => {
    const button = event.target instanceof Element && event.target.closest("[data-ballbot]");
    if (button && button.dataset.ballbot === "screenshot") screenshot();
    if (button && button.dataset.ballbot === "link") link(button);
  });

  // viser's own settings are in the address, too.
  const query = [...new URLSearchParams(location.search)].filter(([name]) => !/^(websocket|initialCamera)/.test(name));
  if (query.length) {
    const socket = new WebSocket(location.origin.replace(/^http/, "ws") + "/drive");
    socket.onopen = () => {
      socket.send(JSON.stringify({ restore: new URLSearchParams(query).toString() }));
      setTimeout(() => socket.close(), 1000);
    };
  }
})();
