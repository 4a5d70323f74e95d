// The server's news as they come; dialled again for ever, a little later each time, when the line breaks.

const FIRST_RETRY_S = 1;
const LONGEST_RETRY_S = 15;

/** Dispatches "news" (detail: a message), "open", "closed" (detail: seconds until the next try). */
export class Live extends EventTarget {
  #socket = null;
  #retry = FIRST_RETRY_S;
  #timer = null;
  #names = "";

  start() {
    this.#dial();
    // A laptop that wakes up, or a phone that finds its network again, needn't wait.
    addEventListener("online", () => this.#again(0));
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden && this.#socket?.readyState !== WebSocket.OPEN) this.#again(0);
    });
  }

  get open() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  #dial() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/live?vehicles=${this.#names}`);
    this.#socket = socket;
    socket.onopen = () => {
      this.#retry = FIRST_RETRY_S;
      this.dispatchEvent(new Event("open"));
    };
    socket.onmessage = (event) => {
      if (socket !== this.#socket) return;
      this.dispatchEvent(new CustomEvent("news", { detail: JSON.parse(event.data) }));
    };
    socket.onclose = () => {
      if (socket !== this.#socket) return;
      this.dispatchEvent(new CustomEvent("closed", { detail: this.#retry }));
      this.#again(this.#retry);
      this.#retry = Math.min(LONGEST_RETRY_S, 1.6 * this.#retry);
    };
  }

  #again(seconds) {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      if (this.#socket?.readyState === WebSocket.CONNECTING || this.open) return;
      this.#dial();
    }, 1000 * seconds);
  }

  /** Whose news are wanted from now on: those that are on show. */
  follow(names) {
    const wanted = names.join(",");
    if (wanted === this.#names) return;
    this.#names = wanted;
    if (!this.#socket) return;
    const old = this.#socket;
    this.#dial();
    old.close();
  }
}
