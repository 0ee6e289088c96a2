// SPDX-License-Identifier: Apache-2.0
// The message that a change leaves nothing to see, with "Undo".
import { isGrey } from '../../core/projection.js';
import { t } from '../../core/text.js';

/** Shows `text` as the message `id` if nothing is visible; isLate() → true once the state has changed since the call. */
export async function tellIfNothing({ prompts, transfer, viewer }, { id, text, isLate }) {
  if (isGrey(viewer.view)) return; // it does not use the transfer function
  const part = await viewer.visiblePart();
  if (part?.visible !== false || isLate()) return;
  prompts.show(id, { text, actions: [{ label: t('transfer.undo'), press: () => transfer.undo(performance.now()) }] });
}
