// SPDX-License-Identifier: Apache-2.0
// Draws a frame as another camera would see it, with a GPU: a mesh with a vertex per cell of the depth, each at its place in the other camera.
import { depthMatrix } from '../../core/warp_depth.js';

const VERTEX = `#version 300 es
uniform highp sampler2D depths;
uniform mat4 place;
uniform ivec2 grid; // columns, rows
uniform vec2 cell; // extent of a cell, of the image
out vec2 at;
void main() {
  ivec2 vertex = ivec2(gl_VertexID % grid.x, gl_VertexID / grid.x);
  at = (vec2(vertex) + 0.5) * cell;
  at = mix(at, vec2(0.0), equal(vertex, ivec2(0)));
  at = mix(at, vec2(1.0), equal(vertex, grid - 1));
  float value = max(texelFetch(depths, vertex, 0).r, 1.0 / 255.0); // what shows nothing lies behind the rest
  gl_Position = place * vec4(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, value, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
uniform sampler2D image;
in vec2 at;
out vec4 color;
void main() { color = texture(image, at); }`;

function programOf(gl) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return gl.getProgramParameter(program, gl.LINK_STATUS) ? program : null;
}

/** Two triangles for each four neighbours of a grid. */
function indicesOf(columns, rows) {
  const indices = new Uint32Array(6 * (columns - 1) * (rows - 1));
  let at = 0;
  for (let y = 0; y + 1 < rows; y += 1) {
    for (let x = 0; x + 1 < columns; x += 1) {
      const a = y * columns + x;
      indices.set([a, a + 1, a + columns, a + 1, a + columns + 1, a + columns], at);
      at += 6;
    }
  }
  return indices;
}

/** False if the browser draws WebGL on the processor. The name of the renderer tells it; the option failIfMajorPerformanceCaveat is not reliable.
 * Asks another canvas, because a canvas keeps the first kind of context that it gets. */
function hasGpu() {
  const gl = new OffscreenCanvas(1, 1).getContext('webgl2', { failIfMajorPerformanceCaveat: true });
  const info = gl?.getExtension('WEBGL_debug_renderer_info');
  const name = gl?.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) ?? '';
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return Boolean(gl) && !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

export class GlWarp {
  #gl; #canvas; #uniforms;
  #frame = null; // {camera, cells, near, far, aspect}
  #grid = ''; // of the buffer of indices
  #count = 0; // of indices

  /** Returns null if this browser draws WebGL 2 without a GPU, or not at all. lost(): called when the browser drops the context; nothing is drawn
   * until it restores the context and the next frame comes. */
  static create(canvas, lost) {
    if (!hasGpu()) return null;
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: false });
    if (!gl) return null;
    const warp = new GlWarp();
    [warp.#gl, warp.#canvas] = [gl, canvas];
    canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      warp.#frame = null;
      lost();
    });
    canvas.addEventListener('webglcontextrestored', () => warp.#start());
    return warp.#start() ? warp : null;
  }

  #start() {
    const gl = this.#gl;
    const program = programOf(gl);
    if (!program) return false;
    gl.useProgram(program);
    this.#uniforms = Object.fromEntries(['depths', 'image', 'place', 'grid', 'cell'].map((name) => [name, gl.getUniformLocation(program, name)]));
    gl.uniform1i(this.#uniforms.depths, 0);
    gl.uniform1i(this.#uniforms.image, 1);
    for (const [unit, filter] of [gl.NEAREST, gl.LINEAR].entries()) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
      for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
      for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.enable(gl.DEPTH_TEST);
    this.#grid = '';
    return true;
  }

  /** Takes a frame: its image, the image of its depth, and {camera, cells, near, far}. False: there is no GPU at the moment. */
  take(image, map, { camera, cells, near, far }) {
    const gl = this.#gl;
    if (gl.isContextLost()) return false;
    for (const [unit, source] of [map, image].entries()) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, source);
    }
    if (this.#grid !== String(cells)) {
      const indices = indicesOf(cells[0], cells[1]);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.DYNAMIC_DRAW);
      this.#grid = String(cells);
      this.#count = indices.length;
    }
    gl.uniform2i(this.#uniforms.grid, cells[0], cells[1]);
    gl.uniform2f(this.#uniforms.cell, 4 / image.width, 4 / image.height);
    this.#frame = { camera, cells, near, far, aspect: image.width / image.height };
    return true;
  }

  /** Draws the frame for a camera of the view, with a size in px and a background [red, green, blue]. False: there is no frame. */
  draw(camera, [width, height], ground) {
    const gl = this.#gl;
    if (!this.#frame || gl.isContextLost()) return false;
    if (this.#canvas.width !== width || this.#canvas.height !== height) [this.#canvas.width, this.#canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(ground[0], ground[1], ground[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(this.#uniforms.place, false, depthMatrix(this.#frame, camera, width / height));
    gl.drawElements(gl.TRIANGLES, this.#count, gl.UNSIGNED_INT, 0);
    return true;
  }
}
