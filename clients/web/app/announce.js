// SPDX-License-Identifier: Apache-2.0
// Announces the features that later.js loads: their buttons, keys and sections exist from the start.
import { t } from '../core/text.js';
import { byId } from './controls/dom.js';
import { TOOLS } from './measure/measure_buttons.js';
import { Announcer } from './shell/announcer.js';
import { ORDER } from './shell/panel.js';

export function install(app) {
  const later = new Announcer(app, () => import('./later.js'));
  app.later = later;

  for (const { kind, icon, key, needs } of TOOLS) {
    later.button({ id: `tool-${kind}`, icon, key, label: t(`measure.tool.${kind}`), group: 'measure', isToggle: true, needs });
  }
  app.shortcuts.add('Delete', () => app.measures?.removeSelected() ?? false, t('measure.remove.key'));
  later.section({ id: 'measure', title: t('measure.section'), order: ORDER.measure });
  later.notifications('session.measures');

  later.section({ id: 'edit', title: t('edits.section'), order: ORDER.edit, needs: 'grid' });

  for (const name of ['open', 'openVolume']) later.call(name);
  byId('open-button').addEventListener('click', () => app.open());
  byId('banner-open').addEventListener('click', () => app.open());
  app.shortcuts.add('o', () => app.open(), t('open.shortcut'));

  later.fold('path');

  later.section({ id: 'capture', title: t('capture.section'), order: ORDER.capture });
  later.button({ id: 'tool-capture', icon: 'camera', label: t('capture.save'), key: 's', group: 'capture' });

  later.section({ id: 'compare', title: t('compare.section'), order: ORDER.compare });
  later.button({ id: 'tool-compare', icon: 'columns-2', label: t('compare.tool'), group: 'compare', isToggle: true });
}
