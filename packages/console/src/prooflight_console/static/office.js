// Of users and set up: copy what is shown once.
"use strict";

document.addEventListener("click", async (event) => {
  const button = event.target.closest("button");
  if (!button) return;
  if ("copy" in button.dataset) {
    try {
      await navigator.clipboard.writeText(button.dataset.copy);
      button.textContent = button.dataset.copied;
    } catch {
      // Without TLS there is no clipboard: the text is selected instead, for Ctrl-C.
      getSelection().selectAllChildren(button.parentElement.querySelector("code"));
    }
  }
});

// --- Set up: what the camera sees, as it goes ---

const view = document.getElementById("camera-live");
if (view) {
  const events = new EventSource(view.dataset.events);
  events.addEventListener("camera", (event) => {
    view.innerHTML = JSON.parse(event.data);
    view.dataset.ready = "";
  });
  events.addEventListener("end", () => location.assign("/sign-in?next=/setup"));
  addEventListener("pagehide", () => events.close());
}
