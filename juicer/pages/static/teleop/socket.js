// The connection: frames and status in, states and commands out.

const FRAME = 1;
const HEADER_BYTES = 28;
const RECONNECT_MS = 1000;

/** Takes a frame apart; see juicer/pages/teleoperating/wire.py. */
export function unpack(buffer) {
  const view = new DataView(buffer);
  if (view.getUint8(0) !== FRAME) throw new Error("this is no frame");
  const count = view.getUint8(1);
  const frame = {
    number: view.getInt32(4, true),
    heard: view.getInt32(8, true),
    movedBy: view.getInt32(12, true),
    step: view.getInt32(16, true),
    sentMs: view.getFloat64(20, true),
    images: [],
  };
  let offset = HEADER_BYTES + 4 * count;
  for (let index = 0; index < count; index += 1) {
    const length = view.getUint32(HEADER_BYTES + 4 * index, true);
    frame.images.push(length ? new Uint8Array(buffer, offset, length) : null);
    offset += length;
  }
  return frame;
}

export class Connection extends EventTarget {
  #socket = null;

  constructor() {
    super();
    this.#open();
  }

  get isOpen() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  send(message) {
    if (this.isOpen) this.#socket.send(JSON.stringify(message));
  }

  #open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/teleop/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.#tell("open");
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.#tell("message", JSON.parse(data));
      else this.#tell("frame", unpack(data));
    };
    socket.onclose = ({ reason }) => {
      this.#tell("closed", reason);
      setTimeout(() => this.#open(), RECONNECT_MS);
    };
    this.#socket = socket;
  }

  #tell(kind, detail) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }
}
