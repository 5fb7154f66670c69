/**
 * Speaks the page's wire as `rustled` does, of sessions that are made up: for the page's tests, and for work on the page.
 *   node tests/page/mock.mjs [PORT [BUILT_PAGE_FOLDER]]
 */
import { createServer } from "node:http";
import { readFile } from "node:fs/promises";
import { extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import { WebSocketServer } from "ws";
import { frameMessage, somewhere, topologyMessage, TRIANGLES, VERTICES } from "./mock_sheet.mjs";
import { paperSample, pcmMessage } from "./mock_sound.mjs";

const TYPES = { ".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml" };
const RATE = 48000;
const BLOCK = 960;
const SECRET = "0123456789012345678901234567890123456789";
const CAUSES = [{}, { backlog: 41 }, { quota: 310, reordered: 4 }, {}, {}, { not_finite: 3 }, {}, {}];
const NAMES = ["flag", "letter being torn", "kitchen roll", "banknote", "origami crane", "curtain, north window", "map, folded", "book, page 214"];

export const PAGE = process.env.RUSTLE_PAGE_PATH ?? fileURLToPath(new URL("../../server/page/web/dist", import.meta.url));
export const KEY = SECRET;

/** One browser's connection. */
class Viewer {
  watched = null;
  heard = null;
  frame = 0;
  sample = 0;
  heardSince = 0;

  constructor(socket, mock) {
    this.socket = socket;
    this.mock = mock;
    this.rights = { ...mock.rights };
    this.say({ type: "hello", ...this.hello() });
    this.tellFigures();
    socket.on("message", (data) => this.onMessage(JSON.parse(String(data))));
    this.timers = [setInterval(() => this.tellFigures(), 250), setInterval(() => this.tellFrame(), 1000 / 30), setInterval(() => this.tellSound(), 10)];
    socket.on("close", () => this.timers.forEach(clearInterval));
  }

  hello() {
    return { version: 1, daemon: "rustled 0.9.0", machine: "workshop", sample_rate: RATE, channels: 2, rights: this.rights, needs_key: this.mock.needsKey };
  }

  say(message) {
    this.socket.send(JSON.stringify(message));
  }

  onMessage(message) {
    this.mock.received.push(message);
    const session = this.mock.sessions.find(({ id }) => id === message.session);
    switch (message.type) {
      case "watch":
        this.watched = session ?? null;
        if (session) this.tellScene();
        break;
      case "listen":
        this.heard = session ?? null;
        this.heardSince = performance.now();
        this.sample = this.mock.sampleNow();
        break;
      case "gain":
        if (!this.rights.change) return this.refuse();
        session.gains_db[message.kind] = message.db;
        break;
      case "listener":
        if (!this.rights.change) return this.refuse();
        session.listener.position = message.position;
        this.tellScene();
        break;
      case "key":
        if (message.secret !== SECRET) return this.say({ type: "notice", level: "error", text: "This key was not let in. Ask who runs the daemon: rustle keys allow." });
        this.rights = { listen: true, change: true };
        this.say({ type: "hello", ...this.hello() });
        break;
      default:
        this.say({ type: "notice", level: "error", text: `${message.type} is nothing that a page may ask.` });
    }
  }

  refuse() {
    this.say({ type: "notice", level: "error", text: "This page may look, not change: give a key." });
  }

  tellScene() {
    const session = this.watched;
    this.say({
      type: "scene",
      session: session.id,
      listener: session.listener,
      obstacles: [{ id: 1, kind: "plane", name: "table", position: [0, 0, 0], orientation: [1, 0, 0, 0] }],
      sheets: [{ index: 0, id: 1, material: "printer-paper", vertices: VERTICES, triangles: TRIANGLES }],
    });
    this.socket.send(topologyMessage(0));
  }

  tellFigures() {
    const { mock } = this;
    const seconds = (performance.now() - mock.began) / 1000;
    const sessions = mock.sessions.map(({ listener: _, ...session }, i) => {
      const received = Math.floor(60 * (seconds + 100 * (i + 1)));
      const lost = Object.values(session.dropped).reduce((sum, n) => sum + n, 0);
      const level = -18 - 9 * i + 5 * Math.sin(seconds * (1 + 0.3 * i));
      const { dropped, ...rest } = session;
      return {
        ...rest,
        clock: i % 3 === 2 ? "simulation" : "live",
        ended: false,
        sample_rate: RATE,
        channels: 2,
        rights: this.rights,
        playout_delay_ms: i % 3 === 2 ? 0 : 40,
        sheets: 1 + (i % 2),
        voices: Math.round(14 + 10 * Math.sin(seconds + i)),
        frames: { received, analysed: received - lost, dropped },
        peak_db: i === 7 ? null : level,
        rms_db: i === 7 ? null : level - 12,
      };
    });
    const level_names = ["full quality", "bursts merged", "fewer voices", "fewer events", "no new sessions"];
    this.say({
      type: "figures",
      time_s: Date.now() / 1000,
      uptime_s: 86400 + seconds,
      load_level: mock.loadLevel,
      load_level_name: level_names[mock.loadLevel],
      cpu_share: 0.62 + 0.04 * Math.sin(seconds),
      latency_ms: { p50: 3.1 + 0.2 * Math.sin(seconds), p99: 7.9 + Math.sin(seconds / 3) },
      pcm_gaps: 0,
      viewers: mock.server.clients.size,
      sessions,
    });
  }

  tellFrame() {
    if (!this.watched) return;
    const t = (performance.now() - this.mock.began) / 1000;
    this.socket.send(frameMessage(0, t));
    ++this.frame;
    const busy = Math.sin(2 * t) > 0 ? 2 : 0;
    const crumples = Array.from({ length: busy }, (_, k) => ({ position: somewhere(t, k), amplitude_m: 10 ** (-2.6 + 1.2 * Math.sin(17 * t + k)), area_m2: 4e-3 }));
    const contacts = this.frame % 3 === 0 ? [0, 1, 2].map((k) => ({ position: [0.09 * Math.cos(k * 2 + t / 9), 0.13 * Math.sin(k * 2 + t / 9), 0], slip_m_s: k * 0.3, area: 1e-4 })) : [];
    const tears = this.frame % 40 < 12 ? [{ position: somewhere(0.02 * this.frame, 4), speed_m_s: 0.4 }] : [];
    if (crumples.length + contacts.length + tears.length > 0) this.say({ type: "events", session: this.watched.id, sheet: 0, time_s: t, crumples, contacts, tears });
  }

  tellSound() {
    if (!this.heard) return;
    while (this.sample + BLOCK <= this.mock.sampleNow()) {
      this.sample += this.mock.toLeaveOut;
      this.mock.toLeaveOut = 0;
      this.socket.send(pcmMessage(this.sample, BLOCK, 2, this.mock.sample));
      this.sample += BLOCK;
    }
  }
}

export class Mock {
  began = performance.now();
  received = [];
  loadLevel = 0;
  toLeaveOut = 0;

  constructor({ sessions = 8, rights = { listen: true, change: true }, needsKey = false, sample = paperSample, page = PAGE, files = {} } = {}) {
    Object.assign(this, { rights, needsKey, sample, page, files });
    const gains = () => ({ master: 0, crumpling: 0, friction: -6, tearing: 0 });
    this.sessions = NAMES.slice(0, sessions).map((name, i) => ({
      id: `s-${i + 1}`,
      name,
      dropped: CAUSES[i],
      gains_db: gains(),
      listener: { position: [0.12, -0.2, 0.24], forward: null, up: [0, 0, 1] },
    }));
  }

  sampleNow() {
    return Math.floor(((performance.now() - this.began) / 1000) * RATE);
  }

  /** So many samples of the sound are not sent, as for a page that reads too slowly. */
  leaveOut(samples) {
    this.toLeaveOut = samples;
  }

  async listen(port = 0) {
    this.http = createServer((request, response) => void this.serve(request, response));
    this.server = new WebSocketServer({ server: this.http, path: "/live", handleProtocols: (offered) => (offered.has("rustle.page.1") ? "rustle.page.1" : false) });
    this.server.on("connection", (socket) => new Viewer(socket, this));
    await new Promise((resolve, reject) => this.http.once("error", reject).listen(port, "127.0.0.1", resolve));
    this.port = this.http.address().port;
    this.url = `http://127.0.0.1:${this.port}/`;
    return this;
  }

  async close() {
    for (const client of this.server.clients) client.terminate();
    this.server.close();
    this.http.closeAllConnections();
    await new Promise((resolve) => this.http.close(resolve));
  }

  async serve(request, response) {
    const path = normalize(new URL(request.url, "http://mock").pathname);
    try {
      const body = this.files[path] ?? await readFile(join(this.page, path === "/" ? "index.html" : path));
      response.writeHead(200, { "content-type": TYPES[extname(path)] ?? TYPES[".html"], "content-security-policy": "default-src 'self'", "cache-control": "no-cache" });
      response.end(body);
    } catch {
      response.writeHead(404).end();
    }
  }
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const mock = new Mock(process.argv[3] ? { page: process.argv[3] } : {});
  await mock.listen(Number(process.argv[2] ?? 7399));
  console.log(mock.url);
}
