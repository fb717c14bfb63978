/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The thread that drives a camera on the network: connect, hold its options, stream, connect again.
 * All functions are the loop thread's.
 */
#ifndef LP_SOURCE_OSC_CAPTURE_H
#define LP_SOURCE_OSC_CAPTURE_H

#include "include/source.h"

struct lp_osc_capture;
struct lp_osc_settings;

/* 0; -ENOMEM and others, logged. `settings` is copied. */
int lp_osc_capture_create(const struct lp_osc_settings *settings, struct lp_osc_capture **capture);

/* Host callbacks come on the loop of `source`. 0 or -errno, logged. */
int lp_osc_capture_start(struct lp_osc_capture *capture, struct lp_source *source);
void lp_osc_capture_caps(struct lp_osc_capture *capture, struct lp_source_caps *caps);

/* 0; -EOPNOTSUPP: this camera's exposure cannot be set, logged. */
int lp_osc_capture_set_exposure(struct lp_osc_capture *capture, float exposure_us, float gain);

/* Accepts NULL. Puts the camera's options back: takes some seconds if it does not answer. */
void lp_osc_capture_destroy(struct lp_osc_capture *capture);

#endif
