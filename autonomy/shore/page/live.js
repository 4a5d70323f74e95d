// The server's news as they come; dialled again for ever, a little later each time, when the line breaks.

const FIRST_RETRY_S = 1;
const LONGEST_RETRY_S = 15;
const SILENCE_S = 30; // a line that is open but dead

/** Dispatches "news" (detail: a message), "open", "closed" (detail: seconds until the next try). */
export class Live extends EventTarget {
  #socket = null;
  #retry = FIRST_RETRY_S;
  #timer = null;
  #heard = 0;

  start() {
    this.#dial();
    setInterval(() => this.#listen(), 1000);
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
    const socket = new WebSocket(`${scheme}://${location.host}/api/live`);
    this.#socket = socket;
    this.#heard = Date.now();
    socket.onopen = () => {
      this.#retry = FIRST_RETRY_S;
      this.dispatchEvent(new Event("open"));
    };
    socket.onmessage = (event) => {
      this.#heard = Date.now();
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

  #listen() {
    if (this.open && Date.now() - this.#heard > 1000 * SILENCE_S) this.dispatchEvent(new Event("silence"));
  }
}
