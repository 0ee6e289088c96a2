// SPDX-License-Identifier: Apache-2.0
// The panes of the slices and the layouts that show them, with their buttons and keys. They are there before the slices (../announce.js),
// so that the picture has its size from the first frame.
import { t } from '../../core/text.js';
import { layoutButton } from '../shell/layout.js';

export const PANES = ['axial', 'coronal', 'sagittal'];
const LAYOUTS = [{ name: '3d', icon: 'box' }, { name: 'four', icon: 'grid-2x2' }, { name: 'slices', icon: 'columns-3' }];

/** load(): called when a layout shows slices. */
export function installLayouts(app, load) {
  const { layout, shortcuts, storage } = app;
  const names = LAYOUTS.map(({ name }) => name);
  const titles = { axial: t('slices.axial'), coronal: t('slices.coronal'), sagittal: t('slices.sagittal') };
  for (const id of PANES) layout.pane(id, titles[id]);
  LAYOUTS.forEach(({ name, icon }, order) => layoutButton(app, { name, icon, label: t(`slices.layout.${name}`), order, needs: 'grid' }));
  shortcuts.add('l', () => layout.set(names[(names.indexOf(layout.current) + 1) % names.length]), t('slices.layout.next'), 'grid');
  layout.on('change', (name) => {
    storage.remember('layout', name);
    if (layout.showsSlices) load();
  });
  const known = storage.recall('layout');
  if (names.includes(known)) layout.set(known);
}
