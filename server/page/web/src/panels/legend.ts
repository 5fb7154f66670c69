import { create, setAttribute } from "../dom";
import type { LayerName } from "../scene/scene_view";

const LAYERS: [LayerName, string, string][] = [
  ["regions", "Regions", "Parts that resonate as one, a colour each; paper-coloured parts are flat"],
  ["rulings", "Rulings", "Straight lines along which a bent part does not bend"],
  ["ridges", "Ridges", "Sharp folds between regions"],
  ["crumples", "Crumpling", "A ring opens where the sheet buckles; its size says how strongly"],
  ["contacts", "Contacts", "A dot where the sheet slides, larger the faster; hollow where it rests"],
  ["tears", "Tears", "A cross at the tip of a tear"],
];

/** Names what the scene shows; each may be left out. */
export function buildLegend(into: HTMLElement, show: (layer: LayerName, shown: boolean) => void): void {
  for (const [layer, name, meaning] of LAYERS) {
    const button = create("button", "legend-item");
    button.type = "button";
    button.title = meaning;
    button.append(create("i", `legend-sign ${layer}`), create("span", "", name));
    setAttribute(button, "aria-pressed", "true");
    button.addEventListener("click", () => {
      const shown = button.getAttribute("aria-pressed") !== "true";
      setAttribute(button, "aria-pressed", String(shown));
      show(layer, shown);
    });
    into.append(button);
  }
}
