// SPDX-License-Identifier: Apache-2.0
// Server-sent events (text/event-stream), for streams that are read by fetch, since EventSource sends no Authorization.

/** Returns take(text), which takes any pieces of the stream and calls told(event, data) for each event that is whole. */
export function eventReader(told) {
  let rest = '';
  let event = '';
  let data = [];
  const line = (text) => {
    if (text === '') {
      if (data.length) told(event || 'message', data.join('\n'));
      event = '';
      data = [];
      return;
    }
    const [, name, value] = /^([^:]*)(?:: ?([^]*))?$/.exec(text); // a comment has no name
    if (name === 'event') event = value ?? '';
    else if (name === 'data') data.push(value ?? '');
  };
  return (text) => {
    const lines = (rest + text).split(/\r\n|\n|\r(?!$)/); // a \r at the end may be half of \r\n
    rest = lines.pop();
    lines.forEach(line);
  };
}
