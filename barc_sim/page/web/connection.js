// The websocket: passes messages on, and reconnects by itself.

const RETRY_AFTER = [0.25, 0.5, 1, 2, 4]; // [s] before each attempt; the last one repeats
const REFUSED = 1008; // the server refused a message: this page is of another version

export class Connection {
  /** `on`: a function for each type of message, and for rows, lost and closed. */
  constructor(on) {
    this.on = on;
    this.attempts = 0;
    this.ended = false;
    this.greeted = false;
    this.#open();
  }

  send(type, fields = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify({ type, ...fields }));
    return true;
  }

  #open() {
    const address = new URL('socket', location.href);
    address.protocol = address.protocol.replace('http', 'ws');
    this.socket = new WebSocket(address);
    this.socket.binaryType = 'arraybuffer';
    this.socket.onmessage = ({ data }) => this.#receive(data);
    this.socket.onclose = ({ code, reason }) => this.#closed(code, reason);
  }

  #receive(data) {
    if (typeof data !== 'string') {
      this.on.rows(new Float64Array(data));
      return;
    }
    const { type, ...fields } = JSON.parse(data);
    if (type === 'hello') {
      this.attempts = 0;
      fields.continues = this.greeted;
      this.greeted = true;
    }
    // A recorded run is complete, and a run that has ended sends no more.
    if (type === 'end' || fields.replay) this.ended = true;
    this.on[type](fields);
  }

  #closed(code, reason) {
    if (this.ended) return;
    if (code === REFUSED) {
      this.on.closed(reason);
      return;
    }
    this.on.lost();
    const wait = RETRY_AFTER[Math.min(this.attempts, RETRY_AFTER.length - 1)];
    this.attempts += 1;
    setTimeout(() => this.#open(), 1000 * wait);
  }
}
