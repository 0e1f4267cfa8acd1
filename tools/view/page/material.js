// Materials that are lit at the vertices: a fragment only passes a colour on, which is what software can draw fast.
//
// Lights go with the eye: one from above on the left, a weaker one from the right, and sky against ground along z.
// Colours are sRGB from end to end, shaded as a draughtsman would, not as light adds.
import * as THREE from './vendor/three.module.min.js';

const LIGHT = `
  float lit(vec3 normal, vec3 eye, out float shine) {
    vec3 n = normalize(normal), v = normalize(eye);
    if (dot(n, v) < 0.0) n = -n;
    vec3 key = normalize(vec3(-0.45, 0.75, 0.75)), fill = normalize(vec3(0.9, -0.1, 0.5));
    shine = pow(max(dot(n, normalize(key + v)), 0.0), 24.0);
    float sky = 0.5 + 0.5 * dot(n, normalize(mat3(viewMatrix) * vec3(0.0, 0.0, 1.0)));
    return 0.46 + 0.14 * sky + 0.42 * max(dot(n, key), 0.0) + 0.12 * max(dot(n, fill), 0.0);
  }`;

// By its vertices' colours, or one of its own.
export function matter(rgb = null, gloss = 0.1) {
  return new THREE.ShaderMaterial({
    vertexColors: !rgb, side: THREE.DoubleSide,
    polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,  // edges lie before their faces
    uniforms: { own: { value: new THREE.Vector3(...(rgb ?? [1, 1, 1])) }, gloss: { value: gloss }, opacity: { value: 1 } },
    vertexShader: `uniform vec3 own; uniform float gloss; varying vec3 shade; ${LIGHT}
      void main() {
        vec4 p = modelViewMatrix * vec4(position, 1.0);
        float shine, bright = lit(normalMatrix * normal, -p.xyz, shine);
        vec3 of = own;
        #ifdef USE_COLOR
          of *= color;
        #endif
        shade = of * bright + gloss * shine;
        gl_Position = projectionMatrix * p;
      }`,
    fragmentShader: 'uniform float opacity; varying vec3 shade; void main() { gl_FragColor = vec4(shade, opacity); }',
  });
}

// Glass: seen at its rim.
export function glass(rgb) {
  return new THREE.ShaderMaterial({
    transparent: true, depthWrite: false, side: THREE.DoubleSide,
    uniforms: { own: { value: new THREE.Vector3(...rgb) }, strength: { value: 1 } },
    vertexShader: `uniform float strength; varying float cover;
      void main() {
        vec4 p = modelViewMatrix * vec4(position, 1.0);
        float rim = 1.0 - abs(dot(normalize(normalMatrix * normal), normalize(-p.xyz)));
        cover = strength * (0.045 + 0.42 * rim * rim * rim);
        gl_Position = projectionMatrix * p;
      }`,
    fragmentShader: 'uniform vec3 own; varying float cover; void main() { gl_FragColor = vec4(own, cover); }',
  });
}

// Whether WebGL is drawn by the processor.
export function drawnBySoftware() {
  const gl = document.createElement('canvas').getContext('webgl2');
  const info = gl?.getExtension('WEBGL_debug_renderer_info');
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : '';
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
