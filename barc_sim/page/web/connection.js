// The websocket: passes messages on, and reconnects by itself.

const RETRY_AFTER = [0.25, 0.5, 1, 2, 4]; // [s] before each attempt; the last one repeats
const REFUSED = 1008; // the server refused a message: this page is of another version
const FULL = 1013;

const NEXT_RUN = 2; // [s] between two looks for the next run
const FORBIDDEN = 403;
const MOVED = Symbol('a run under another address');

const sleep = (seconds) => new Promise((done) => { setTimeout(done, 1000 * seconds); });

/** Return the id of the run at this address, null if none answers, or MOVED. */
async function fetchRun() {
  try {
    const response = await fetch(new URL('run', location.href), { cache: 'no-store' });
    if (response.status === FORBIDDEN) return MOVED;
    return response.ok ? await response.text() : null;
  } catch {
    return null;
  }
}

export class Connection {
  /** `on`: a function for each type of message, and for rows, lost, closed and moved. */
  constructor(on) {
    this.on = on;
    this.attempts = 0;
    this.ended = false;
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
    if (type === 'run') {
      this.isNew = this.run !== fields.id;
      this.run = fields.id;
      return;
    }
    if (type === 'hello') {
      this.attempts = 0;
      fields.continues = !this.isNew;
    }
    // A recorded run is complete, and a run that has ended sends no more.
    if (type === 'end' || fields.replay) this.ended = true;
    if (type === 'end') this.#lookForNextRun();
    this.on[type](fields);
  }

  #closed(code, reason) {
    if (this.ended) return;
    if (code === REFUSED || code === FULL) {
      this.on.closed(reason);
      return;
    }
    this.on.lost();
    this.#retry();
  }

  /** Connect again, unless another run serves this port under another address. */
  async #retry() {
    const wait = RETRY_AFTER[Math.min(this.attempts, RETRY_AFTER.length - 1)];
    this.attempts += 1;
    await sleep(wait);
    if (await fetchRun() === MOVED) this.on.moved();
    else this.#open();
  }

  /** After the end, report another run at this port. */
  async #lookForNextRun() {
    do await sleep(NEXT_RUN);
    while (await fetchRun() !== MOVED);
    this.on.moved();
  }
}
