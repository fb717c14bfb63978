// SPDX-License-Identifier: Apache-2.0
/** The light as an app has it without a probe: one main light, and ambient light that is the same from everywhere. */
import { besideSh, luminance } from "../src/index.js";
import type { Estimate } from "../src/index.js";

/** Mean irradiance of SH of radiance, over all directions, for each unit of its first coefficient. */
const MEAN_OF_FIRST = Math.PI * 0.28209479177387814;

/** Of an estimate: the brightest lamp without a size, and all other light as its mean. The irradiance in the mean over all directions stays the same. */
export function mainLightAndAmbient(estimate: Estimate): Estimate {
  const [main, ...others] = [...besideSh(estimate)].sort((a, b) => luminance(b.irradiance) - luminance(a.irradiance));
  const ambient = [0, 1, 2].map((c) => estimate.sh.coefficients[c]! + others.reduce((sum, { irradiance }) => sum + irradiance[c]!, 0) / 4 / MEAN_OF_FIRST);
  return { ...estimate, lights: main ? [{ ...main, angularRadiusDeg: 0 }] : [], key: undefined, sh: { kind: estimate.sh.kind, order: 0, coefficients: ambient } };
}
