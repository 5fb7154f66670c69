import { BufferGeometry, Float32BufferAttribute, Group, LineBasicMaterial, LineSegments, Plane, Raycaster, Vector2, Vector3 } from "three";
import { create, setAttribute, setHidden, setText } from "../dom";
import { isDark, onTheme } from "../theme";
import type { Listener, Vec3 } from "../wire/messages";
import { scenePalette } from "./palette";
import type { SceneView } from "./scene_view";

const STEP_M = 0.01;
/** How far the line goes that shows where the listener looks. */
const GAZE_M = 0.06;
const EDGE_PX = 26;
/** At the upper edge a button stands in the corner. */
const UPPER_EDGE_PX = 72;
const SEND_EVERY_MS = 50;
/** The daemon's word is not taken for so long after a move: it may be older than the move. */
const OWN_FOR_MS = 400;

/**
 * Where the session is heard from: a button over the scene, at the edge where the place is out of sight. Dragged along the plane that
 * faces the camera (with Shift at its height), or moved by arrow keys and Page Up and Down.
 */
export class ListenerHandle {
  private readonly button = create("button", "listener-handle");
  private readonly label = create("span", "listener-label");
  private readonly stalk: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly object = new Group();
  private readonly position = new Vector3();
  private forward: Vec3 | null = null;
  private known = false;
  private movable = false;
  private movedAt = -1e9;
  private sentAt = -1e9;
  private sendTimer = 0;
  private readonly projected = new Vector3();
  private width = 0;
  private height = 0;
  private readonly moved: ((position: Vec3) => void)[] = [];

  constructor(
    private readonly view: SceneView,
    private readonly stage: HTMLElement,
    private readonly send: (position: Vec3) => void,
  ) {
    this.button.type = "button";
    this.button.hidden = true;
    this.button.append(create("span", "listener-dot"), this.label);
    setAttribute(this.button, "aria-roledescription", "movable point");
    stage.append(this.button);
    this.stalk = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ transparent: true, opacity: 0.7 }));
    this.stalk.frustumCulled = false;
    this.object.add(this.stalk);
    view.add(this.object);
    onTheme((dark) => this.stalk.material.color.copy(scenePalette(dark).listener));
    this.stalk.material.color.copy(scenePalette(isDark()).listener);
    new ResizeObserver(() => {
      this.width = stage.clientWidth;
      this.height = stage.clientHeight;
      this.follow();
    }).observe(stage);
    this.button.addEventListener("pointerdown", (event) => this.drag(event));
    this.button.addEventListener("keydown", (event) => this.key(event));
  }

  /** Told of every place, also of those that the reader chooses here. */
  onMove(watcher: (position: Vec3) => void): void {
    this.moved.push(watcher);
  }

  setMovable(movable: boolean, reason: string): void {
    this.movable = movable;
    setAttribute(this.button, "aria-disabled", movable ? null : "true");
    this.button.title = movable ? "Drag, or focus and press the arrow keys, Page Up and Page Down (with Shift by 10 cm)" : reason;
  }

  /** As the daemon has it; null where the session has none. */
  show(listener: Listener | null): void {
    this.known = listener !== null;
    setHidden(this.button, !this.known);
    this.object.visible = this.known;
    if (!listener || performance.now() - this.movedAt < OWN_FOR_MS) return;
    this.forward = listener.forward;
    this.place(listener.position);
  }

  /** Moved by the reader, here or with the numbers beside. */
  move(position: Vec3): void {
    if (!this.movable) return;
    this.movedAt = performance.now();
    this.place(position);
    const wait = SEND_EVERY_MS - (this.movedAt - this.sentAt);
    window.clearTimeout(this.sendTimer);
    if (wait <= 0) this.tell();
    else this.sendTimer = window.setTimeout(() => this.tell(), wait);
  }

  /** After the scene was drawn anew. */
  follow(): void {
    if (!this.known) return;
    const { width, height } = this;
    const at = this.projected.copy(this.position).project(this.view.camera);
    const behind = at.z > 1;
    const x = (0.5 + (behind ? -0.5 : 0.5) * at.x) * width;
    const y = (0.5 - (behind ? -0.5 : 0.5) * at.y) * height;
    const shownX = Math.min(Math.max(x, EDGE_PX), width - EDGE_PX);
    const shownY = Math.min(Math.max(y, UPPER_EDGE_PX), height - EDGE_PX);
    const away = behind || shownX !== x || shownY !== y;
    this.button.classList.toggle("away", away);
    this.button.classList.toggle("leftwards", shownX > width / 2);
    this.button.style.transform = `translate(${shownX.toFixed(1)}px, ${shownY.toFixed(1)}px)`;
  }

  private place(position: Vec3): void {
    this.position.set(...position);
    const [x, y, z] = position;
    const ends = [x, y, z, x, y, 0];
    if (this.forward) ends.push(x, y, z, x + GAZE_M * this.forward[0], y + GAZE_M * this.forward[1], z + GAZE_M * this.forward[2]);
    this.stalk.geometry.setAttribute("position", new Float32BufferAttribute(ends, 3));
    setText(this.label, "Listener");
    const spoken = `Listener at x ${x.toFixed(2)}, y ${y.toFixed(2)}, z ${z.toFixed(2)} metres`;
    setAttribute(this.button, "aria-label", spoken);
    for (const watcher of this.moved) watcher(position);
    this.view.invalidate();
  }

  private tell(): void {
    this.sentAt = performance.now();
    this.send([this.position.x, this.position.y, this.position.z]);
  }

  private key(event: KeyboardEvent): void {
    const step = STEP_M * (event.shiftKey ? 10 : 1);
    const by: Record<string, Vec3> = {
      ArrowLeft: [-step, 0, 0],
      ArrowRight: [step, 0, 0],
      ArrowUp: [0, step, 0],
      ArrowDown: [0, -step, 0],
      PageUp: [0, 0, step],
      PageDown: [0, 0, -step],
    };
    const move = by[event.key];
    if (!move) return;
    event.preventDefault();
    this.move([this.position.x + move[0], this.position.y + move[1], this.position.z + move[2]]);
  }

  private drag(down: PointerEvent): void {
    if (!this.movable || down.button !== 0) return;
    this.button.setPointerCapture(down.pointerId);
    const rays = new Raycaster();
    const hit = new Vector3();
    const plane = new Plane();
    const facing = new Vector3();
    const onMove = (event: PointerEvent) => {
      if (event.shiftKey) facing.set(0, 0, 1);
      else this.view.camera.getWorldDirection(facing);
      plane.setFromNormalAndCoplanarPoint(facing, this.position);
      const box = this.stage.getBoundingClientRect();
      const at = new Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
      rays.setFromCamera(at, this.view.camera);
      if (rays.ray.intersectPlane(plane, hit)) this.move([hit.x, hit.y, hit.z]);
    };
    const onUp = () => {
      this.button.removeEventListener("pointermove", onMove);
      this.button.removeEventListener("pointerup", onUp);
      this.button.removeEventListener("pointercancel", onUp);
    };
    this.button.addEventListener("pointermove", onMove);
    this.button.addEventListener("pointerup", onUp);
    this.button.addEventListener("pointercancel", onUp);
  }
}
