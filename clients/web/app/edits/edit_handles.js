// SPDX-License-Identifier: Apache-2.0
// Handles of the selected edit in the picture, while the section "Edit" is open: of a box, a plane or a sphere.
import { t } from '../../core/text.js';
import { BoxHandles, PlaneHandles, SphereHandles } from '../controls/handle_shapes.js';
import { Handles } from '../controls/handles.js';

/** section: the fold; edits: see Edits in edits.js. */
export function installEditHandles(app, edits, section) {
  const { clip, transfer } = app;
  const selected = () => edits.list[edits.selected];
  const name = () => t('edits.handles.name', { name: t(`edits.name.${selected().type}`), number: edits.selected + 1 });
  const handles = new Handles(app, {
    id: 'edit-handles', label: t('edits.handles'), draw, leave: () => edits.select(-1), begin: () => edits.begin(), end: () => edits.end(),
    isShown: () => section.open && app.viewer.kind === 'grid' && Boolean(clip.volumeBox) && selected()?.type in shapes,
  });
  const set = (change, time) => edits.change(edits.selected, change, time);
  const shapes = {
    box: new BoxHandles(handles, clip, { get box() { return selected().box; }, setBox: (box, time) => set({ box }, time) }, () => t('edits.move', { name: name() })),
    plane: new PlaneHandles(handles, clip, {
      get plane() { return selected(); }, setPlane: ({ normal, offset }, time) => set({ normal, offset }, time), get index() { return edits.selected; }, select: () => {},
    }),
    sphere: new SphereHandles(handles, clip, { get center() { return selected().center; }, get radius() { return selected().radius; }, set }),
  };

  function draw(project, lines) {
    const { type } = selected();
    for (const [kind, { elements }] of Object.entries(shapes)) if (kind !== type) elements.forEach((element) => { element.hidden = true; });
    shapes[type].draw(project, lines, { name: name() });
  }

  transfer.onShow(() => handles.update());
  section.addEventListener('toggle', () => handles.update());
}
