/* SPDX-License-Identifier: Apache-2.0 */
/* Fields that several messages have: for the files of this folder. */
#ifndef LP_SERVE_CODEC_CODEC_FIELDS_H
#define LP_SERVE_CODEC_CODEC_FIELDS_H

#include "proto/lightprobe.pb.h"
#include "serve/drawn/drawn.h"

/* Whether any error is known. */
bool lp_fill_drawn(lightprobe_v1_Drawn *wire, const struct lp_drawn *drawn);

#endif
