// SPDX-License-Identifier: Apache-2.0
/** The client in a page: an app of somebody's own server. */
import { Probe } from "../../src/index.js";
import { lightEstimate } from "../../src/webxr.js";

Object.assign(window, { Probe, lightEstimate });
