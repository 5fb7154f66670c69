import { decodeBinary, type BinaryMessage } from "./binary";
import { parseMessage, type ClientMessage, type ServerMessage } from "./messages";

export interface ConnectionEvents {
  open(): void;
  /** Tries again in so many seconds. */
  lost(retryInSeconds: number): void;
  message(message: ServerMessage): void;
  binary(message: BinaryMessage): void;
  /** Something came that is not as the protocol says. */
  unreadable(): void;
}

const SUBPROTOCOL = "rustle.page.1";
const FIRST_RETRY_S = 0.5;
const LONGEST_RETRY_S = 8;

/** The page's one WebSocket; connects again for as long as the page is open, each time a little later. */
export class Connection {
  private socket: WebSocket | null = null;
  private retryInSeconds = FIRST_RETRY_S;
  private retryTimer = 0;

  constructor(
    private readonly url: string,
    private readonly events: ConnectionEvents,
  ) {}

  connect(): void {
    window.clearTimeout(this.retryTimer);
    const socket = new WebSocket(this.url, SUBPROTOCOL);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.retryInSeconds = FIRST_RETRY_S;
      this.events.open();
    };
    socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => this.take(data);
    socket.onclose = () => {
      this.socket = null;
      this.events.lost(this.retryInSeconds);
      this.retryTimer = window.setTimeout(() => this.connect(), 1000 * this.retryInSeconds);
      this.retryInSeconds = Math.min(2 * this.retryInSeconds, LONGEST_RETRY_S);
    };
  }

  /** False where there is no connection now: what was asked is lost, and asked anew by who needs it after `open`. */
  send(message: ClientMessage): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  private take(data: string | ArrayBuffer): void {
    let text: ServerMessage | null = null;
    let binary: BinaryMessage | null = null;
    try {
      if (typeof data === "string") text = parseMessage(data);
      else binary = decodeBinary(data);
    } catch {
      this.events.unreadable();
      return;
    }
    if (text) this.events.message(text);
    if (binary) this.events.binary(binary);
  }
}
