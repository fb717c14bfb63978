/* SPDX-License-Identifier: Apache-2.0 */
/* What a source did about its camera's processing (include/processing.h), for log and clients. */
#ifndef LP_SOURCE_PROCESSING_H
#define LP_SOURCE_PROCESSING_H

#include <stdbool.h>
#include <stdint.h>

#include "include/processing.h"

/* The key `processing` of sources: values of it, and their words for a parameter's `choices`. */
enum lp_processing_wish { LP_PROCESSING_NEUTRAL, LP_PROCESSING_KEEP };
extern const char *const lp_processing_wishes[];
#define LP_PROCESSING_HELP                                                                 \
	"neutral: switch off what alters the light, as sharpening, as far as the camera\n" \
	"can; keep: leave it as it is, for a camera file that was measured so"

#define LP_PROCESSING_TEXT_BYTES 320

/* Zeroed at first: nothing is on, nothing was changed. */
struct lp_processing_report {
	uint32_t on;				 /* LP_PROCESSING_BIT() of what is on */
	char off_text[LP_PROCESSING_TEXT_BYTES]; /* what was switched off: "sharpness 3 → 0" */
	char on_text[LP_PROCESSING_TEXT_BYTES];	 /* what is on, and why: "gamma 220 (read-only)" */
};

/* Note, in words, what was switched off; or that `kind` is on, and why. Too much text is cut. */
__attribute__((format(printf, 2, 3))) void lp_processing_off(struct lp_processing_report *report,
							     const char *format, ...);
__attribute__((format(printf, 3, 4))) void lp_processing_on(struct lp_processing_report *report,
							    enum lp_processing kind,
							    const char *format, ...);

/* Log it, unless it is what `*told` says was logged last, which is zeroed at first. `keep`: it is
 * on because the user wants so. */
void lp_processing_tell(const struct lp_processing_report *report, bool keep,
			struct lp_processing_report *told, const char *object);

#endif
