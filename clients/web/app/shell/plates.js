// SPDX-License-Identifier: Apache-2.0
// Plates: labels, bars and messages that lie above the pictures. They have tooltips and sometimes a button, but a drag, a wheel or a right
// drag on them belongs to the picture below, as if they were not there.
import { byId } from '../controls/dom.js';

const PICTURES = '#screen, #screen-b, .slice';
const PLATES = '#toolbar, #scale-bar, #color-bar, #status, #mode-bar, #notice, .prompt, .slice-foot, .slice-problem';
const CONTROLS = ':is(button,input)';
const MENU = '#toolbar-menu'; // a list of its own, which may scroll
const TYPES = ['pointerdown', 'pointermove', 'dblclick', 'contextmenu', 'wheel'];

/** True if an event belongs to the picture below. The wheel has no meaning for handles and sliders, so it always does. */
function isForPicture({ target, type }) {
  if (target.closest(PICTURES) || target.closest(MENU)) return false;
  return type === 'wheel' ? !target.matches('[type="number"]') : target.closest(PLATES) && !target.closest(CONTROLS);
}

function passOn(event) {
  if (!isForPicture(event)) return;
  const picture = document.elementsFromPoint(event.clientX, event.clientY).find((element) => element.matches(PICTURES));
  const { constructor: Type, type } = event;
  if (picture && !picture.dispatchEvent(new Type(type, event))) event.preventDefault();
}

export function install() {
  for (const root of [document.querySelector('main'), byId('tools'), byId('mode-bar'), byId('messages'), byId('status')]) {
    for (const type of TYPES) root.addEventListener(type, passOn, { passive: false });
  }
}
