// SPDX-License-Identifier: Apache-2.0
// The switch "Predict motion" of this window (warp.js).
import { byId } from '../controls/dom.js';
import { follow } from './warp.js';

export function install(app) {
  const { warp, storage } = app;
  const isOn = byId('warping');
  isOn.checked = storage.recall('warping') !== 'no';
  warp.isOn = isOn.checked;
  isOn.addEventListener('change', () => {
    storage.remember('warping', isOn.checked ? 'yes' : 'no');
    warp.isOn = isOn.checked;
  });
  follow(app);
}
