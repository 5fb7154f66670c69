import { Color, DoubleSide, ShaderMaterial, Vector3 } from "three";

/**
 * Paper under a lamp: a colour per triangle, lit from both sides, the back a little darker. The normal is half the smooth one, half the
 * triangle's own, so that folds stay sharp and bends stay round.
 */
export function sheetMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    side: DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 2,
    uniforms: {
      towardsLamp: { value: new Vector3(-0.35, -0.55, 0.85).normalize() },
      sky: { value: new Color(1, 1, 1) },
    },
    vertexShader: /* glsl */ `
      attribute vec3 tint;
      flat varying vec3 shownTint;
      varying vec3 smoothNormal;
      varying vec3 place;
      void main() {
        shownTint = tint;
        smoothNormal = normal;
        place = position;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }`,
    fragmentShader: /* glsl */ `
      uniform vec3 towardsLamp;
      flat varying vec3 shownTint;
      varying vec3 smoothNormal;
      varying vec3 place;
      void main() {
        vec3 towardsEye = normalize(cameraPosition - place);
        vec3 flatNormal = normalize(cross(dFdx(place), dFdy(place)));
        if (dot(flatNormal, towardsEye) < 0.0) flatNormal = -flatNormal;
        vec3 round = length(smoothNormal) > 0.0 ? normalize(smoothNormal) : flatNormal;
        if (dot(round, flatNormal) < 0.0) round = -round;
        vec3 n = normalize(mix(round, flatNormal, 0.4));
        float lamp = max(dot(n, towardsLamp), 0.0);
        float through = max(dot(-n, towardsLamp), 0.0);
        float sky = 0.5 + 0.5 * n.z;
        float light = 0.46 + 0.40 * lamp + 0.16 * through + 0.14 * sky;
        vec3 colour = shownTint * light;
        if (!gl_FrontFacing) colour *= 0.86;
        float shine = pow(max(dot(n, normalize(towardsLamp + towardsEye)), 0.0), 32.0);
        gl_FragColor = vec4(colour + 0.06 * shine, 1.0);
        #include <colorspace_fragment>
      }`,
  });
}
