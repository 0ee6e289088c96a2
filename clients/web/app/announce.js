// SPDX-License-Identifier: Apache-2.0
// Announces the parts of the page that load on demand: their buttons, keys and sections exist from the start. A part is a module in parts/
// with its texts, its features and its style sheets.
import { t } from '../core/text.js';
import { byId } from './controls/dom.js';
import { TOOLS } from './measure/measure_buttons.js';
import { Announcer } from './shell/announcer.js';
import { ORDER } from './shell/panel.js';
import { installLayouts } from './slices/slices_layouts.js';

export function install(app) {
  const later = new Announcer(app);
  app.later = later;

  const clip = later.part('clip', () => import('./parts/clip.js'), { styles: ['clip'] });
  clip.section({ id: 'clip', title: t('clip.section'), order: ORDER.clip });
  clip.button({ id: 'clip-tool', icon: 'scissors', label: t('clip.tool'), key: 'c', group: 'tools', order: 50, isToggle: true });
  clip.section({ id: 'edit', title: t('edits.section'), order: ORDER.edit, needs: 'grid' });

  const slices = later.part('slices', () => import('./parts/slices.js'), { styles: ['slices'] });
  installLayouts(app, () => slices.ask());
  slices.section({ id: 'slices', title: t('slices.section'), order: ORDER.slices, needs: 'grid' });

  const measure = later.part('measure', () => import('./parts/measure.js'), { styles: ['measure'], after: [slices] });
  for (const { kind, icon, key, needs } of TOOLS) {
    measure.button({ id: `tool-${kind}`, icon, key, label: t(`measure.tool.${kind}`), group: 'measure', isToggle: true, needs });
  }
  app.shortcuts.add('Delete', () => app.measures?.removeSelected() ?? false, t('measure.remove.key'));
  measure.section({ id: 'measure', title: t('measure.section'), order: ORDER.measure });
  measure.notifications('session.measures');

  const files = later.part('files', () => import('./parts/files.js'), { styles: ['open'] });
  for (const name of ['open', 'openVolume']) files.call(name);
  byId('open-button').addEventListener('click', () => app.open());
  byId('banner-open').addEventListener('click', () => app.open());
  app.shortcuts.add('o', () => app.open(), t('open.shortcut'));

  later.part('paths', () => import('./parts/paths.js'), { styles: ['paths'] }).fold('path');

  const capture = later.part('capture', () => import('./parts/capture.js'), { styles: ['capture'] });
  capture.section({ id: 'capture', title: t('capture.section'), order: ORDER.capture });
  capture.button({ id: 'tool-capture', icon: 'camera', label: t('capture.save'), key: 's', group: 'capture' });

  const compare = later.part('compare', () => import('./parts/compare.js'), { styles: ['compare'] });
  compare.section({ id: 'compare', title: t('compare.section'), order: ORDER.compare });
  compare.button({ id: 'tool-compare', icon: 'columns-2', label: t('compare.tool'), group: 'compare', isToggle: true });
}
