// The one WebSocket: words as JSON, rows as binary frames. Every connection begins afresh with `hello`.

const HEAD = 16; // bytes: uint32 stream and number, uint32 rows, float64 time of the first row
const OVER = 1000; // the drives have ended as they should: nobody is there any more
const PLAIN = new Set(["hello", "ask", "open", "runs", "history", "stop"]);
const WAITS_MS = [500, 1000, 2000, 4000];

export class Link {
  /** `on`: {hello, rows, up, <word>…}, each called with what came. */
  constructor(language, on) {
    Object.assign(this, { language, on, seen: 0, tries: 0, came_ms: 0, up: false });
    this.token = tokenOf(location);
    this.answers = new Map();
    this.asked = 0;
    this.fields = [0, 0, 0]; // numbers a row, of each stream
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`, "baqueano.1");
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      const hello = { is: "hello", lang: this.language };
      if (this.token) hello.token = this.token;
      this.send(hello);
    };
    socket.onmessage = ({ data }) => {
      if (socket !== this.socket) return;
      if (typeof data === "string") this.#word(JSON.parse(data));
      else this.#frame(data);
    };
    socket.onclose = ({ code }) => {
      if (socket !== this.socket) return;
      this.up = false;
      this.answers.clear();
      if (code === OVER) { this.on.over(); return; }
      this.on.up(false);
      this.timer = setTimeout(() => this.connect(), WAITS_MS[Math.min(this.tries++, WAITS_MS.length - 1)]);
    };
  }

  /** Begin again, in another language. */
  restart(language) {
    this.language = language;
    clearTimeout(this.timer);
    const old = this.socket;
    this.socket = null;
    old.close();
    this.connect();
  }

  /** Send a word. One that drives names the vehicle for which it is meant. */
  send(word) {
    if (this.robot && !PLAIN.has(word.is)) word = { ...word, robot: this.robot };
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(word));
  }

  /** Ask, and call `then` with the answer. */
  ask(what, more, then) {
    const id = ++this.asked;
    this.answers.set(id, then);
    this.send({ is: "ask", id, what, ...more });
  }

  #word(word) {
    if (word.is === "hello") {
      this.up = true;
      this.tries = 0;
      this.robot = word.robot;
      this.fields[0] = word.fields.length;
    }
    if (word.is === "answer" && word.to === "ask") {
      this.answers.get(word.id)?.(word);
      this.answers.delete(word.id);
      return;
    }
    if (word.is === "answer" && word.to === "open" && word.fields) this.fields[word.stream] = word.fields.length;
    this.on[word.is]?.(word);
  }

  #frame(data) {
    const head = new DataView(data, 0, HEAD), n = head.getUint32(0, true), rows = head.getUint32(4, true);
    const stream = n >>> 24, number = n & 0xffffff;
    if (stream > 2 || data.byteLength !== HEAD + 4 * rows * this.fields[stream]) return;
    if (stream === 0) {
      this.number = number;
      this.came_ms = performance.now();
    }
    this.on.rows(stream, new Float32Array(data, HEAD), rows);
  }

  /** What has been drawn is what has come: called at the end of each drawing. */
  drawn() { this.seen = this.number ?? 0; }

  /** Return how old the picture is [ms]. */
  get age_ms() { return this.came_ms ? performance.now() - this.came_ms : 0; }
}

/** Take the token out of the address: it is never sent in a request, nor shown any more. */
function tokenOf({ hash, pathname, search }) {
  const given = new URLSearchParams(hash.slice(1));
  const token = given.get("token") ?? given.get("t");
  if (token) {
    sessionStorage.setItem("token", token);
    history.replaceState(null, "", pathname + search);
  }
  return token ?? sessionStorage.getItem("token");
}
