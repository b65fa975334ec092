// The queue: sends files one after another, tickets first, and says how far each has come.
"use strict";

const form = document.getElementById("send");
const told = document.getElementById("sending");

const isTicket = (file) => /\.(xjdf|jdf)$/i.test(file.name);

function send(file) {
  return new Promise((resolve) => {
    const request = new XMLHttpRequest();
    request.open("POST", "/api/v1/queue/files?name=" + encodeURIComponent(file.name));
    request.setRequestHeader("X-CSRF-Token", document.querySelector('meta[name="csrf"]').content);
    request.setRequestHeader("Accept-Language", document.documentElement.lang);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.upload.onprogress = (event) => {
      if (event.lengthComputable) told.textContent = `${file.name}: ${Math.round((100 * event.loaded) / event.total)} %`;
    };
    request.onload = () => {
      if (request.status === 201) resolve("");
      else try { resolve(JSON.parse(request.responseText).detail); } catch { resolve(String(request.status)); }
    };
    request.onerror = () => resolve(form.dataset.failed);
    request.send(file);
  });
}

form?.addEventListener("submit", async (event) => {
  event.preventDefault();
  const button = form.querySelector("button");
  const files = [...form.elements.files.files].sort((a, b) => isTicket(b) - isTicket(a));
  const wrong = [];
  button.disabled = true;
  for (const file of files) {
    const why = await send(file);
    if (why) wrong.push(`${file.name}: ${why}`);
  }
  button.disabled = false;
  told.textContent = wrong.length ? wrong.join("; ") : form.dataset.sent;
  told.classList.toggle("wrong", wrong.length > 0);
  if (!wrong.length) form.reset();
  htmx.trigger("#jobs", "sent");
});
