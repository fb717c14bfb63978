/* SPDX-License-Identifier: Apache-2.0 */
/* The pixels of single blocks of a frame that lp_jpeg_read() has read: for the few blocks that
 * matter. */
#ifndef LP_VISION_JPEG_PIXELS_H
#define LP_VISION_JPEG_PIXELS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_jpeg_reader;

/* Codes R, G, B of the 8 x 8 pixels of luma block (bx, by), row by row, as a decoder gives them
 * that repeats chroma. Padding beyond the picture included. */
void lp_jpeg_block_rgb(const struct lp_jpeg_reader *reader, int bx, int by, uint8_t rgb[64][3]);

#ifdef __cplusplus
}
#endif

#endif
