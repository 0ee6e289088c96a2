// SPDX-License-Identifier: Apache-2.0
// Images or video while the view moves, and images without loss at rest. The choices belong to this window.
import { t } from '../../core/text.js';
import { videoFormats } from '../../core/video.js';
import { byId } from '../controls/dom.js';

const AUTO = 'auto'; // images, and video where the network is too slow for them
const CHEAPEST_FIRST = ['vp8', 'h264', 'vp9']; // in memory and CPU time of the daemon

export function install(app) {
  const { storage, notice, frames, report } = app;
  const moving = byId('moving');
  const lossless = byId('lossless');
  let videos = []; // formats that this browser decodes and that, once it has answered, the daemon has
  const nameOf = (choice) => t(`moving.${choice}`);
  const formatOf = (choice) => (choice === AUTO ? ['jpeg', ...CHEAPEST_FIRST.filter((name) => videos.includes(name))] : [choice, 'jpeg']);
  const isKnown = videoFormats(window.VideoDecoder).then((names) => {
    videos = names;
    if (names.length === 0) return;
    moving.add(new Option(nameOf(AUTO), AUTO), 0);
    for (const name of names) moving.add(new Option(nameOf(name), name));
    const known = storage.recall('moving');
    moving.value = [...moving.options].some(({ value }) => value === known) ? known : AUTO;
  });

  async function choose(choice) {
    storage.remember('moving', choice);
    moving.value = choice;
    const granted = await app.configure({ format: formatOf(choice) });
    if (granted?.format === 'jpeg' && videos.includes(choice) && choice === moving.value) {
      moving.value = 'jpeg';
      notice.show(t('moving.missing', { format: nameOf(choice) }), 'warning');
    }
  }

  /** Removes the formats that the daemon does not have: formats of the answer to stream.configure. */
  function keepGranted(formats) {
    videos = videos.filter((name) => formats.includes(name));
    for (const option of [...moving.options]) {
      if (![AUTO, 'jpeg', ...videos].includes(option.value) || (option.value === AUTO && videos.length === 0)) option.remove();
    }
  }

  moving.addEventListener('change', () => choose(moving.value));
  lossless.checked = storage.recall('lossless') === 'yes';
  lossless.addEventListener('change', () => {
    storage.remember('lossless', lossless.checked ? 'yes' : 'no');
    app.configure({ lossless: lossless.checked });
  });
  frames.on('video-failed', (error) => {
    report(new Error(t('moving.undecodable', { reason: error.message })));
    choose('jpeg');
  });
  app.formats = {
    /** Resolves to {format, lossless} of stream.configure, once it is known what this browser decodes. */
    wanted: async () => {
      await isKnown;
      return { format: formatOf(moving.value), lossless: lossless.checked };
    },
    keepGranted,
  };
}
