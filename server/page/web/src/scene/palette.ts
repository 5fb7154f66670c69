import { Color } from "three";

/**
 * Region colours that people with any colour vision tell apart (after Okabe and Ito, and Tol), in an order whose neighbours differ most.
 * Ridges between regions are drawn as well, so colour is never all there is.
 */
export const REGION_COLOURS = ["#f0a06a", "#3fb0c4", "#c9a7e0", "#5fb98d", "#e9cf5a", "#5f8fd6", "#d9749b"].map((hex) => new Color(hex));

export interface ScenePalette {
  background: Color;
  /** A sheet where it belongs to no region: paper. */
  paper: Color;
  /** How dark the shadow on the floor is, 0 to 1. */
  shadow: number;
  ridge: Color;
  ruling: Color;
  grid: Color;
  gridStrong: Color;
  obstacle: Color;
  crumple: Color;
  contact: Color;
  tear: Color;
  /** Around all three: they show on paper and on the ground. */
  halo: Color;
  listener: Color;
}

const LIGHT: ScenePalette = {
  background: new Color("#faf9f6"),
  paper: new Color("#f3ece4"),
  shadow: 0.1,
  ridge: new Color("#8a1f3d"),
  ruling: new Color("#2b2f36"),
  grid: new Color("#e4e1da"),
  gridStrong: new Color("#d3cfc6"),
  obstacle: new Color("#b9b6af"),
  crumple: new Color("#c8451b"),
  contact: new Color("#1d5fb4"),
  tear: new Color("#6a1b9a"),
  halo: new Color("#ffffff"),
  listener: new Color("#1b6b5c"),
};

const DARK: ScenePalette = {
  background: new Color("#14171b"),
  paper: new Color("#d8d0c6"),
  shadow: 0.35,
  ridge: new Color("#d0245c"),
  ruling: new Color("#11151a"),
  grid: new Color("#22272d"),
  gridStrong: new Color("#30373f"),
  obstacle: new Color("#4a515a"),
  crumple: new Color("#c8451b"),
  contact: new Color("#1d5fb4"),
  tear: new Color("#6a1b9a"),
  halo: new Color("#fff8f0"),
  listener: new Color("#5fd0b8"),
};

export function scenePalette(dark: boolean): ScenePalette {
  return dark ? DARK : LIGHT;
}
