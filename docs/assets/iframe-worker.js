// Browsers start no worker from a page that is read from a file, and search needs one: here it runs in a hidden frame.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.room = new Promise((ready) => {
        const frame = document.createElement("iframe");
        frame.hidden = true;
        frame.srcdoc = "<!doctype html><html><body></body></html>";
        frame.onload = () => {
          const room = frame.contentWindow;
          room.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
          const script = room.document.createElement("script");
          script.src = url;
          script.onload = () => ready(room);
          room.document.body.append(script);
        };
        document.documentElement.append(frame);
      });
    }

    postMessage(data) {
      this.room.then((room) => room.dispatchEvent(new room.MessageEvent("message", { data })));
    }
  };
}
