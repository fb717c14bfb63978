// SPDX-License-Identifier: Apache-2.0
export { Probe, parseAddress } from "./client.js";
export type { ProbeEvents, ProbeOptions, State } from "./client.js";
export { EstimateFlag, LightFlag, besideSh, fallbackEstimate, flagNames, irradiance, luminance, meanIrradiance } from "./estimate.js";
export type { Drawn, Estimate, Health, Hello, Light, Pong, Refusal, Room, SphericalHarmonics, Vec3 } from "./estimate.js";
export { ggxLevels } from "./ggx.js";
export { estimateAt, lightAt } from "./place.js";
export { largest, reflected } from "./reflection.js";
export type { ReflectionMap } from "./reflection.js";
export { reflectionMapAt } from "./reflection_place.js";
export * as sh from "./sh.js";
export { WireError, decode, encodePing, encodePose, encodeSubscription, unmet } from "./wire.js";
export type { HeadPlace } from "./wire.js";
export type { Message, ReflectionMapWish, Subscription } from "./wire.js";
