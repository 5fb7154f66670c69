import { byId, setText } from "../dom";
import type { Vec3 } from "../wire/messages";

/** The listener's place as three numbers, which may be typed. */
export class ListenerNumbers {
  private readonly inputs = ["x", "y", "z"].map((axis) => byId<HTMLInputElement>(`listener-${axis}`));
  private readonly hint = byId("listener-hint");

  constructor(move: (position: Vec3) => void) {
    for (const input of this.inputs) {
      input.disabled = true;
      input.addEventListener("change", () => {
        const [x, y, z] = this.inputs.map(({ value }) => Number.parseFloat(value));
        if ([x, y, z].every((value) => Number.isFinite(value))) move([x!, y!, z!]);
      });
    }
  }

  show(position: Vec3): void {
    this.inputs.forEach((input, axis) => {
      const text = position[axis]!.toFixed(2);
      if (document.activeElement !== input && input.value !== text) input.value = text;
    });
  }

  setState(enabled: boolean, hint: string): void {
    for (const input of this.inputs) if (input.disabled === enabled) input.disabled = !enabled;
    setText(this.hint, hint);
  }
}
