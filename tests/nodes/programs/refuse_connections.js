// Makes each new connection one that does not open, until `reconnect` is called.
(() => {
  const { WebSocket } = window;
  window.WebSocket = class {
    static OPEN = WebSocket.OPEN;
    constructor() {
      window.reconnect = () => {
        window.WebSocket = WebSocket;
        this.onclose({ code: 1006 });
      };
    }
  };
})()
