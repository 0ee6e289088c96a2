// SPDX-License-Identifier: Apache-2.0
// Slices in the 3-D picture: their outlines and the crosshair above it, and the mode in which a click there moves the crosshair.
import { meetPlane, ray } from '../../core/project.js';
import { t } from '../../core/text.js';
import { add, dot, scale, subtract } from '../../core/vector.js';
import { svg } from '../controls/dom.js';

export class SlicesPicture {
  #app; #slices;

  /** slices: the state of slices.js. */
  constructor(app, slices) {
    this.#app = app;
    this.#slices = slices;
    this.#addPicking();
    app.overlay.layer((project, { group }) => this.#drawIn3d(project, group));
  }

  /** The mode in which a click or a drag in the picture moves the crosshair to what is seen there. */
  #addPicking() {
    const { modes, toolbar, connection, screen, notice, viewer } = this.#app;
    let wanted = null; // {at, time}
    let isAsking = false;
    const pick = async () => {
      if (isAsking || !wanted) return;
      const { at, time } = wanted;
      wanted = null;
      isAsking = true;
      try {
        const { position } = await connection.call('pick', screen.pickAt(at));
        const nearest = this.#nearest(at, position);
        if (nearest) this.#slices.setPosition(nearest, time);
      } catch (error) {
        notice.show(error.message, 'error');
      } finally {
        isAsking = false;
        pick();
      }
    };
    const want = (at, { timeStamp }) => {
      wanted = { at, time: timeStamp };
      pick();
    };
    modes.add('crosshair', { label: t('slices.crosshair'), hint: t('slices.crosshair.hint'), cursor: 'crosshair', down: want, move: want });
    const button = toolbar.button({
      id: 'tool-crosshair', icon: 'crosshair', label: t('slices.crosshair'), group: 'tools', isToggle: true, needs: 'grid', press: () => modes.toggle('crosshair'),
    });
    modes.on('change', (name) => button.setAttribute('aria-pressed', String(name === 'crosshair')));
    viewer.on('view', () => { button.disabled = !viewer.canControl; });
  }

  /** The point seen at a place of the picture: of a slice in it, or of the volume (`position`) if that lies in front. */
  #nearest(at, position) {
    const { viewer, screen } = this.#app;
    const { in_3d: isDrawn, mode } = this.#slices.shared;
    if (!isDrawn || mode === 'none' || !this.#slices.grid) return position;
    const sight = ray(viewer.rig, at, screen.viewport);
    const planes = this.#slices.isOblique ? [this.#slices.planeOf('sagittal')] : this.#slices.planesIn3d;
    const points = planes.map((plane) => meetPlane(sight, plane.origin, plane.normal)).filter((point) => point && this.#slices.grid.has(point));
    const way = (point) => dot(subtract(point, sight.origin), sight.direction);
    return [...points, ...(position ? [position] : [])].sort((a, b) => way(a) - way(b))[0] ?? null;
  }

  /** Outlines of the slices, and the crosshair, above the picture. A comparison hides them: they would mark A alone. */
  #drawIn3d(project, group) {
    const isOn = this.#slices.grid && this.#slices.shared && !this.#app.compare?.isOn && (this.#slices.areShown || this.#slices.shared.mode !== 'none');
    group.toggleAttribute('hidden', !isOn);
    if (!isOn) return group.replaceChildren();
    const parts = [];
    const line = (from, to, kind, name) => {
      const [a, b] = [project(from), project(to)];
      if ([a.x, a.y, b.x, b.y].every(Number.isFinite)) {
        parts.push(svg('line', { class: name, 'data-kind': kind, x1: a.x, y1: a.y, x2: b.x, y2: b.y }));
      }
    };
    const { grid, position } = this.#slices;
    const distances = grid.distances(position);
    for (const { kind, axis } of this.#slices.isOblique ? [] : this.#slices.planesIn3d) {
      const [u, v] = [0, 1, 2].filter((a) => a !== axis);
      const corner = (i, j) => add(position, add(scale(grid.axes[u], grid.extent(u)[i] - distances[u]), scale(grid.axes[v], grid.extent(v)[j] - distances[v])));
      const corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
      corners.forEach((from, i) => line(from, corners[(i + 1) % 4], kind, 'slice-outline'));
    }
    for (const a of [0, 1, 2]) {
      const reach = 0.04 * (grid.extent(a)[1] - grid.extent(a)[0]);
      line(add(position, scale(grid.axes[a], -reach)), add(position, scale(grid.axes[a], reach)), 'cross', 'slice-cross');
    }
    return group.replaceChildren(...parts);
  }
}
