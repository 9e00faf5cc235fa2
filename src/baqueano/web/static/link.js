// The WebSocket: messages as JSON, rows as binary frames. Each connection begins with `hello`.

const HEAD = 16; // bytes: uint32 stream and number, uint32 rows, float64 time of the first row
const OVER = 1000; // the drives have ended normally

export class Link {
  /** `on`: {rows, down, over, <word>…}, each called with the received data. */
  constructor(language, on) {
    Object.assign(this, { language, on, frame: 0, number: 0, tries: 0, came_ms: 0, id: 0, token: tokenOf(location), answers: new Map() });
    this.fields = [0, 0, 0]; // of each stream
    this.connect();
  }

  connect() {
    const socket = new WebSocket(`${location.origin.replace("http", "ws")}/ws`, "baqueano.3");
    socket.binaryType = "arraybuffer";
    Object.assign(this, { socket, up: false, silent: 0 });
    this.answers.clear();
    socket.onopen = () => this.send({ type: "hello", lang: this.language, ...(this.token && { token: this.token }) });
    socket.onmessage = ({ data }) => {
      if (socket !== this.socket) return;
      this.silent = 0;
      if (typeof data === "string") this.#word(JSON.parse(data));
      else this.#frame(data);
    };
    socket.onclose = ({ code }) => {
      if (socket !== this.socket) return;
      this.up = false;
      if (code === OVER) { this.on.over(); return; }
      this.on.down();
      this.timer = setTimeout(() => this.connect(), Math.min(500 * 2 ** this.tries++, 4000));
    };
  }

  restart(language) {
    this.language = language;
    clearTimeout(this.timer);
    const old = this.socket;
    this.connect();
    old.close();
  }

  /** Send a message with the vehicle that it addresses. */
  send(word) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ ...word, robot: this.robot }));
  }

  ask(question, more, then) {
    this.answers.set(++this.id, then);
    this.send({ type: "ask", id: this.id, question, ...more });
  }

  #word(word) {
    if (word.type === "hello") Object.assign(this, { up: true, tries: 0, robot: word.robot, fields: [word.fields.length, 0, 0] });
    if (word.to === "ask" && word.type === "answer") {
      this.answers.get(word.id)?.(word);
      this.answers.delete(word.id);
      return;
    }
    if (word.to === "open" && word.fields) this.fields[word.stream] = word.fields.length;
    this.on[word.type]?.(word);
  }

  #frame(data) {
    const head = new DataView(data, 0, HEAD), n = head.getUint32(0, true), rows = head.getUint32(4, true), stream = n >>> 24;
    if (data.byteLength !== HEAD + 4 * rows * this.fields[stream]) return;
    if (stream === 0) [this.number, this.came_ms] = [n, performance.now()];
    this.on.rows(stream, new Float32Array(data, HEAD), rows);
  }
}

/** Remove the token from the address, so that it is never sent or shown. */
function tokenOf({ hash, pathname, search }) {
  const token = new URLSearchParams(hash.slice(1)).get("token");
  if (token) {
    sessionStorage.setItem("token", token);
    history.replaceState(null, "", pathname + search);
  }
  return token ?? sessionStorage.getItem("token");
}
