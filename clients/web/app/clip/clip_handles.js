// SPDX-License-Identifier: Apache-2.0
// Handles of the clip box and of the clip planes in the picture.
import { t } from '../../core/text.js';
import { BoxHandles, PlaneHandles } from '../controls/handle_shapes.js';
import { Handles } from '../controls/handles.js';

/** leave(): hides the handles. */
export function installClipHandles(app, state, leave) {
  const planes = []; // PlaneHandles, by index
  const handles = new Handles(app, {
    id: 'clip-handles', label: t('clip.handles'), isShown: () => state.hasHandles && Boolean(state.volumeBox), draw, leave,
  });
  const box = new BoxHandles(handles, state, state);

  const plane = (index) => new PlaneHandles(handles, state, {
    get plane() { return state.entries[index].plane; }, setPlane: (other, time) => state.setPlane(index, other, time), index, select: () => state.select(index),
  });

  function draw(project, shapes) {
    box.draw(project, shapes);
    while (planes.length > state.entries.length) planes.pop().elements.forEach((element) => element.remove());
    while (planes.length < state.entries.length) planes.push(plane(planes.length));
    state.entries.forEach(({ isOn }, i) => planes[i].draw(project, shapes, { name: t('clip.plane', { number: i + 1 }), isSelected: i === state.selected, isOn }));
  }

  state.on('change', () => handles.update());
}
