/** What goes over `/live` as text: one JSON object a message, named by `type`. Metres, seconds, decibels. */

export type Vec3 = [number, number, number];

export interface Rights {
  listen: boolean;
  change: boolean;
}

export interface Hello {
  type: "hello";
  version: number;
  daemon: string;
  machine: string;
  sample_rate: number;
  channels: number;
  rights: Rights;
  needs_key: boolean;
}

export interface SessionFigures {
  id: string;
  name: string;
  clock: "live" | "simulation";
  ended: boolean;
  /** Of this session's PCM. */
  sample_rate: number;
  channels: number;
  /** A key that only publishes may hear and change what is its own. */
  rights: Rights;
  playout_delay_ms: number;
  sheets: number;
  voices: number;
  frames: { received: number; analysed: number; dropped: Record<string, number> };
  /** Of the last quarter second; null is silence. */
  peak_db: number | null;
  rms_db: number | null;
  /** By kind; absent is 0 dB, null is silence, which has no number in decibels. */
  gains_db: Record<string, number | null>;
}

export interface Figures {
  type: "figures";
  /** Since 1970. */
  time_s: number;
  uptime_s: number;
  /** 0: full quality, to 4. */
  load_level: number;
  load_level_name: string;
  /** 1 is one processor. */
  cpu_share: number;
  /** From a frame's arrival to its sound, beyond the playout delay; null while nothing was measured. */
  latency_ms: { p50: number | null; p99: number | null };
  pcm_gaps: number;
  viewers: number;
  sessions: SessionFigures[];
}

export interface Listener {
  position: Vec3;
  /** null: toward the sheets. */
  forward: Vec3 | null;
}

export interface Obstacle {
  id: string | number;
  kind: "plane" | "box" | "sphere" | "capsule" | "mesh";
  position: Vec3;
  /** w, x, y, z. */
  orientation: [number, number, number, number];
  half_extents?: Vec3;
  radius?: number;
  /** Of a capsule, along its own z, without the caps. */
  half_length?: number;
  /** Its triangles come as binary, by its place in the list. */
  mesh?: boolean;
}

export interface SheetInfo {
  index: number;
  id: number;
  material: string;
  vertices: number;
  triangles: number;
}

export interface Scene {
  type: "scene";
  session: string;
  listener: Listener | null;
  obstacles: Obstacle[];
  sheets: SheetInfo[];
}

export interface SheetEvents {
  type: "events";
  session: string;
  sheet: number;
  time_s: number;
  crumples: { position: Vec3; amplitude_m: number; area_m2: number }[];
  contacts: { position: Vec3; slip_m_s: number; area: number }[];
  tears: { position: Vec3; speed_m_s: number }[];
}

export interface Notice {
  type: "notice";
  text: string;
  level: "info" | "warning" | "error";
}

export type ServerMessage = Hello | Figures | Scene | SheetEvents | Notice;

export type ClientMessage =
  | { type: "watch"; session: string | null; frames_per_second: number }
  | { type: "listen"; session: string | null }
  | { type: "gain"; session: string; kind: string; db: number | null }
  | { type: "listener"; session: string; position: Vec3 }
  | { type: "key"; secret: string };

const KNOWN = new Set(["hello", "figures", "scene", "events", "notice"]);

/** The message, or null where it is none that this page knows: a newer daemon may say more. */
export function parseMessage(text: string): ServerMessage | null {
  const parsed: unknown = JSON.parse(text);
  if (typeof parsed !== "object" || parsed === null || !("type" in parsed)) return null;
  return KNOWN.has(String(parsed.type)) ? (parsed as ServerMessage) : null;
}
