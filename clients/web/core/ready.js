// SPDX-License-Identifier: Apache-2.0
// Waits for a volume that the daemon loads.

/** Resolves to a volume of the list as soon as it is ready; rejects with the daemon's reason if loading fails, or if the volume is closed before. */
export function whenReady(connection, id) {
  return new Promise((resolve, reject) => {
    let isKnown = false;
    const look = (volumes) => {
      const volume = volumes.find((one) => one.id === id);
      if (volume?.state === 'loading' || (!volume && !isKnown)) {
        isKnown = Boolean(volume);
        return;
      }
      stop();
      if (volume?.state === 'ready') resolve(volume);
      else reject(new Error(volume?.reason ?? ''));
    };
    const stop = connection.on('volumes', look);
    connection.refresh().catch(() => {}); // the stream reports a lost daemon
  });
}
