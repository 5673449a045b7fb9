/* Browsers start no worker for a page that was opened from the disk. The search's worker then runs in
   a hidden frame instead, which does the same on the page's own thread. */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      const inside = (this.inside = frame.contentWindow);
      const answer = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      inside.postMessage = (data) => setTimeout(answer, 0, data);
      const load = (src) =>
        new Promise((resolve, reject) => {
          const script = inside.document.createElement("script");
          Object.assign(script, { src, onload: resolve, onerror: reject });
          inside.document.body.append(script);
        });
      inside.importScripts = (...urls) =>
        urls.reduce((done, src) => done.then(() => load(src)), Promise.resolve());
      this.ready = load(new URL(url, location).href);
    }
    postMessage(data) {
      this.ready.then(() => this.inside.dispatchEvent(new MessageEvent("message", { data })));
    }
    set onmessage(listen) {
      this.addEventListener("message", listen);
    }
    terminate() {
      this.inside.frameElement.remove();
    }
  };
}
