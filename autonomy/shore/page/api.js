// Requests to the server that the page came from; nothing is ever asked of another.

export class ServerError extends Error {
  constructor(status, text) {
    super(text || `the server answered ${status}`);
    this.status = status;
  }
}

async function ask(path, signal) {
  const answer = await fetch(path, { signal, headers: { Accept: "application/json, application/octet-stream" } });
  // The token's cookie has run out.
  if (answer.status === 401) location.assign("/login");
  if (!answer.ok) throw new ServerError(answer.status, (await answer.text()).slice(0, 200));
  return answer;
}

const of = (vehicle) => `/api/vehicle/${encodeURIComponent(vehicle)}`;

export const vehicles = async () => (await ask("/api/vehicles")).json();
export const colormaps = async () => (await ask("/api/colormaps")).json();
export const latest = async (vehicle) => (await ask(of(vehicle))).json();
export const history = async (vehicle) => (await ask(`${of(vehicle)}/history`)).json();

export async function predict(vehicle, lat, lon, at, signal) {
  const query = new URLSearchParams({ lat: lat.toFixed(7), lon: lon.toFixed(7), at });
  return (await ask(`${of(vehicle)}/predict?${query}`, signal)).json();
}

/** Mean and standard deviation over a window {south, west, north, east}, row 0 in the north, NaN where there is none. */
export async function map(vehicle, at, window, rows, columns, signal) {
  const query = new URLSearchParams({ at, rows, columns });
  for (const side of ["south", "west", "north", "east"]) query.set(side, window[side].toFixed(7));
  const answer = await ask(`${of(vehicle)}/map?${query}`, signal);
  const numbers = new Float32Array(await answer.arrayBuffer());
  const cells = rows * columns;
  if (numbers.length !== 2 * cells) throw new Error(`the map has ${numbers.length} numbers, not ${2 * cells}`);
  return { window, rows, columns, mean: numbers.subarray(0, cells), sd: numbers.subarray(cells) };
}
