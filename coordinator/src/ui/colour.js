// From numbers to colours: the image's exposure and transfer curve, the maps' colours, the workers' colours.

/** viridis (van der Walt and Smith 2015) as Zucker's polynomial: the same as the coordinator's PNG maps. */
const VIRIDIS = [
  [0.2777273272234177, 0.005407344544966578, 0.3340998053353061],
  [0.1050930431085774, 1.404613529898575, 1.384590162594685],
  [-0.3308618287255563, 0.214847559468213, 0.09509516302823659],
  [-4.634230498983486, -5.799100973351585, -19.33244095627987],
  [6.228269936347081, 14.17993336680509, 56.69055260068105],
  [4.776384997670288, -13.74514537774601, -65.35303263337234],
  [-5.435455855934631, 4.645852612178535, 26.3124352495832],
];
const table = Array.from({ length: 256 }, (_, i) => [0, 1, 2].map((channel) => {
  const value = VIRIDIS.reduceRight((sum, power) => sum * (i / 255) + power[channel], 0);
  return Math.round(255 * Math.min(1, Math.max(0, value)));
}));
export const UNKNOWN = [110, 110, 110];
export const viridis = (t) => table[Math.round(255 * Math.min(1, Math.max(0, t)))];

/** A 16-bit float's value (IEEE 754 binary16). */
export function half(bits) {
  const exponent = bits >> 10 & 31, fraction = bits & 1023, sign = bits & 0x8000 ? -1 : 1;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}

/** Byte of the sRGB curve (IEC 61966-2-1) for every 16-bit float, at an exposure in stops. */
export function exposed(stops) {
  const gain = 2 ** stops;
  return Uint8Array.from({ length: 65536 }, (_, bits) => {
    const linear = half(bits) * gain;
    if (!(linear > 0)) return 0;
    if (linear >= 1) return 255;
    return Math.round(255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055));
  });
}

/** A worker's colour: hues a golden angle apart, so that neighbours in number are far apart in colour. */
export const workerColour = (id) => `hsl(${(Number(id.slice(1)) * 137.508) % 360} 85% 60%)`;
