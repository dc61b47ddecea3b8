// Colours that tell clusters apart, and numbers: the same as in the window and in reports.

// Stops of the colour map viridis (Smith and van der Walt), evenly apart.
const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];

/** The whole of it, as a gradient in CSS. */
export const GRADIENT = `linear-gradient(to right, ${VIRIDIS.join(", ")})`;

const channels = (stop) => [1, 3, 5].map((at) => parseInt(VIRIDIS[stop].slice(at, at + 2), 16) / 255);

/** Its stops as numbers from 0 to 1, one after the other, for shaders. */
export const stops = () => new Float32Array(VIRIDIS.flatMap((_, stop) => channels(stop)));

/** A colour of viridis, from 0 to 1. */
export function viridis(share) {
  const place = Math.min(1, Math.max(0, share)) * (VIRIDIS.length - 1);
  const stop = Math.min(Math.floor(place), VIRIDIS.length - 2);
  const [low, high] = [channels(stop), channels(stop + 1)];
  return [...low.map((from, channel) => from + (place - stop) * (high[channel] - from)), 1];
}

/** A colour for a number, different from those of its neighbours. */
export function distinct(number) {
  const turn = (number * 0.618034) % 1;
  return [...[0, 1 / 3, 2 / 3].map((shift) => 0.62 + 0.3 * Math.cos(2 * Math.PI * (turn - shift))), 1];
}
