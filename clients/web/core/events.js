// SPDX-License-Identifier: Apache-2.0
// Parses server-sent events (text/event-stream). The page reads them by fetch, because EventSource cannot send a token.

/** Returns take(text), which accepts any pieces of the stream and calls told(event, data) for each complete event. */
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
    const lines = (rest + text).split(/\r\n|\n|\r(?!$)/); // a \r at the end may be the first half of \r\n
    rest = lines.pop();
    lines.forEach(line);
  };
}
