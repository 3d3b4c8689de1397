// The WebSocket to the gateway. It reconnects automatically.
import { type Frame, split } from "./protocol";

type ConnectionState = "open" | "lost";

export class Connection {
  private socket: WebSocket | null = null;
  private wait = 250;
  private heard = 0;
  private lostAt = 0;

  constructor(
    private readonly url: string,
    private readonly on: {
      frame: (frame: Frame) => void;
      state: (state: ConnectionState, text: string) => void;
      bad: (why: string) => void;
    },
  ) {
    this.connect();
    // The state of the gateway comes twice a second. A gateway that hangs sends nothing and does not answer a close.
    setInterval(() => {
      if (this.socket?.readyState === WebSocket.OPEN && performance.now() - this.heard > 3000) this.lose(this.socket);
      if (this.lostAt > 0)
        on.state(
          "lost",
          `connection lost for ${((performance.now() - this.lostAt) / 1000).toFixed(0)} s, reconnecting …`,
        );
    }, 500);
  }

  /** Sends nothing while the connection is lost. */
  send(bytes: ArrayBuffer): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(bytes);
  }

  private connect(): void {
    const socket = new WebSocket(this.url);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.heard = performance.now();
      this.lostAt = 0;
      this.wait = 250;
      this.on.state("open", "connected");
    };
    socket.onmessage = ({ data }) => {
      if (socket !== this.socket) return;
      this.heard = performance.now();
      try {
        for (const frame of split(data as ArrayBuffer)) this.on.frame(frame);
      } catch (error) {
        this.on.bad(String(error));
      }
    };
    socket.onclose = () => this.lose(socket);
  }

  private lose(socket: WebSocket): void {
    if (socket !== this.socket) return; // already replaced
    this.socket = null;
    socket.close();
    if (this.lostAt === 0) {
      this.lostAt = performance.now();
      this.on.state("lost", "connection lost, reconnecting …");
    }
    window.setTimeout(() => this.connect(), this.wait);
    this.wait = Math.min(2000, 1.6 * this.wait);
  }
}
