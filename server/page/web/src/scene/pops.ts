import { BufferAttribute, BufferGeometry, DynamicDrawUsage, NormalBlending, Points, ShaderMaterial } from "three";
import type { SheetEvents, Vec3 } from "../wire/messages";
import type { ScenePalette } from "./palette";

/** The number is what the shader draws: a ring that opens, a dot, a cross. Shapes differ, not colours only. */
export enum PopKind {
  Crumple = 0,
  Contact = 1,
  Tear = 2,
}

const CAPACITY = 2048;
const LIFE_S = [0.7, 0.22, 0.5];
/** After this time half of the loudest is forgotten: quiet passages show as well as loud ones. */
const MEMORY_S = 4;

/** Events that appear where they happened and fade; a ring buffer of points, the oldest is written over. */
export class Pops {
  readonly object: Points<BufferGeometry, ShaderMaterial>;
  readonly layers: [boolean, boolean, boolean] = [true, true, true];
  private readonly place = new BufferAttribute(new Float32Array(3 * CAPACITY), 3).setUsage(DynamicDrawUsage);
  /** birth in s, life in s, strength 0 to 1, kind */
  private readonly traits = new BufferAttribute(new Float32Array(4 * CAPACITY).fill(-1e9), 4).setUsage(DynamicDrawUsage);
  private next = 0;
  private lastDeath = 0;
  private loudest = 0;
  private heardAt = 0;

  constructor(palette: ScenePalette) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.place);
    geometry.setAttribute("traits", this.traits);
    this.object = new Points(geometry, popMaterial());
    this.object.frustumCulled = false;
    this.object.renderOrder = 2;
    this.recolour(palette);
  }

  recolour(palette: ScenePalette): void {
    this.object.material.uniforms["colours"]!.value = [palette.crumple, palette.contact, palette.tear];
    this.object.material.uniforms["halo"]!.value = palette.halo;
  }

  setPixelRatio(ratio: number): void {
    this.object.material.uniforms["pixelRatio"]!.value = ratio;
  }

  add(events: SheetEvents, now: number): void {
    this.loudest *= 0.5 ** ((now - this.heardAt) / MEMORY_S);
    this.heardAt = now;
    for (const { amplitude_m } of events.crumples) this.loudest = Math.max(this.loudest, amplitude_m);
    // Amplitudes span some decades: their root is about how loud they seem.
    if (this.layers[PopKind.Crumple]) {
      for (const { position, amplitude_m } of events.crumples) this.pop(PopKind.Crumple, position, Math.sqrt(amplitude_m / this.loudest), now);
    }
    if (this.layers[PopKind.Contact]) {
      for (const { position, slip_m_s } of events.contacts) this.pop(PopKind.Contact, position, Math.min(1, Math.sqrt(slip_m_s)), now);
    }
    if (this.layers[PopKind.Tear]) {
      for (const { position, speed_m_s } of events.tears) this.pop(PopKind.Tear, position, Math.min(1, 0.4 + speed_m_s), now);
    }
  }

  /** Whether any still shows. */
  advance(now: number): boolean {
    this.object.material.uniforms["now"]!.value = now;
    this.object.visible = now < this.lastDeath;
    return this.object.visible;
  }

  clear(): void {
    this.traits.array.fill(-1e9);
    this.traits.clearUpdateRanges();
    this.traits.needsUpdate = true;
    this.lastDeath = 0;
  }

  private pop(kind: PopKind, position: Vec3, strength: number, now: number): void {
    const at = this.next;
    this.next = (at + 1) % CAPACITY;
    const life = LIFE_S[kind]!;
    this.place.setXYZ(at, position[0], position[1], position[2]);
    this.traits.setXYZW(at, now, life, Number.isFinite(strength) ? strength : 0, kind);
    for (const attribute of [this.place, this.traits]) {
      attribute.addUpdateRange(at * attribute.itemSize, attribute.itemSize);
      attribute.needsUpdate = true;
    }
    this.lastDeath = Math.max(this.lastDeath, now + life);
  }
}

function popMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    transparent: true,
    depthTest: false,
    depthWrite: false,
    blending: NormalBlending,
    uniforms: { now: { value: 0 }, pixelRatio: { value: 1 }, colours: { value: [] }, halo: { value: null } },
    vertexShader: /* glsl */ `
      attribute vec4 traits;
      uniform float now;
      uniform float pixelRatio;
      varying float age;
      varying float strength;
      varying float kind;
      varying float size;
      void main() {
        age = (now - traits.x) / traits.y;
        strength = traits.z;
        kind = traits.w;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        if (age < 0.0 || age > 1.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
        size = kind < 0.5 ? 12.0 + 34.0 * strength : kind < 1.5 ? 9.0 + 8.0 * strength : 18.0 + 14.0 * strength;
        gl_PointSize = size * pixelRatio;
      }`,
    fragmentShader: /* glsl */ `
      uniform vec3 colours[3];
      uniform vec3 halo;
      varying float age;
      varying float strength;
      varying float kind;
      varying float size;
      float stroke(float distance, float width) {
        return 1.0 - smoothstep(width - 0.7, width + 0.7, abs(distance) * size);
      }
      void main() {
        vec2 p = gl_PointCoord - 0.5;
        float r = length(p);
        float fade = 1.0 - age * age;
        float ink, glow;
        vec3 colour = colours[int(kind + 0.5)];
        if (kind < 0.5) {
          float ring = mix(0.16, 0.44, sqrt(age));
          ink = stroke(r - ring, 1.2) * fade + (1.0 - smoothstep(0.05, 0.09, r)) * max(0.0, 1.0 - 2.5 * age);
          glow = stroke(r - ring, 2.6) * fade * 0.75;
        } else if (kind < 1.5) {
          float body = 1.0 - smoothstep(0.30, 0.36, r);
          float hole = strength < 0.05 ? 1.0 - smoothstep(0.16, 0.22, r) : 0.0;
          ink = (body - hole) * fade;
          glow = (1.0 - smoothstep(0.40, 0.46, r)) * fade * 0.8;
        } else {
          float cross = max(stroke(p.x - p.y, 1.9), stroke(p.x + p.y, 1.9)) * (1.0 - smoothstep(0.30, 0.34, r));
          ink = cross * fade;
          glow = max(stroke(p.x - p.y, 4.0), stroke(p.x + p.y, 4.0)) * (1.0 - smoothstep(0.33, 0.40, r)) * fade * 0.8;
        }
        float alpha = max(ink, glow);
        if (alpha < 0.01) discard;
        gl_FragColor = vec4(mix(halo, colour, ink / alpha), alpha);
        #include <colorspace_fragment>
      }`,
  });
}
