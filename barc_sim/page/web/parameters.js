// The parameters that the page can set: what their nodes have, and what the user has asked for.

const PERIOD = 100; // [ms] between two requests for one parameter, while its slider moves
const PATIENCE = 3000; // [ms] for a node's answer

export class Parameters {
  /**
   * `send` takes a name and a value; `changed` is called after every change; `warn` takes a
   * sentence.
   */
  constructor(send, changed, warn, patience = PATIENCE) {
    Object.assign(this, { send, changed, warn, patience });
    this.connected = false;
    this.values = {}; // by name, as the nodes have them
    this.requests = new Map(); // by name: {value, unanswered, isDue, pause, deadline}
  }

  /** Return the value to show: what the user has asked for, until the node has answered. */
  shown(name) {
    const request = this.requests.get(name);
    return request?.unanswered || request?.isDue ? request.value : this.values[name];
  }

  /** Return whether the user can set a parameter now. */
  isEnabled(name) {
    return this.connected && name in this.values;
  }

  /** Take the values that the nodes have now. */
  receive(values) {
    this.values = { ...values };
    this.changed();
  }

  /** A connection can be used from now on, or no longer: no request is answered then. */
  connect(connected) {
    this.connected = connected;
    for (const name of [...this.requests.keys()]) this.#forget(name);
    this.changed();
  }

  /** Ask the node for a value. */
  request(name, value) {
    if (!this.connected) return;
    this.warn('');
    if (!this.requests.has(name)) this.requests.set(name, { unanswered: 0, pause: null });
    const request = this.requests.get(name);
    request.value = value;
    request.isDue = true;
    if (request.pause === null) this.#send(name, request);
    this.changed();
  }

  /** Take a node's answer: the value that it has now. */
  accept(name, value) {
    this.values[name] = value;
    this.#answer(name);
  }

  /** Take a node's answer: it keeps its value, for the reason `why`. */
  refuse(name, why) {
    this.#answer(name);
    this.warn(why);
  }

  #send(name, request) {
    request.isDue = false;
    request.unanswered += 1;
    this.send(name, request.value);
    request.pause = setTimeout(() => {
      request.pause = null;
      if (request.isDue) this.#send(name, request);
      else if (!request.unanswered) this.#forget(name);
    }, PERIOD);
    clearTimeout(request.deadline);
    request.deadline = setTimeout(() => {
      this.#forget(name);
      this.warn(`${name}: its node has not answered within ${this.patience / 1000} s`);
      this.changed();
    }, this.patience);
  }

  #answer(name) {
    const request = this.requests.get(name);
    if (request) {
      request.unanswered = Math.max(request.unanswered - 1, 0);
      const isDone = !request.unanswered && !request.isDue && request.pause === null;
      if (isDone) this.#forget(name);
    }
    this.changed();
  }

  #forget(name) {
    const request = this.requests.get(name);
    clearTimeout(request.pause);
    clearTimeout(request.deadline);
    this.requests.delete(name);
  }
}
