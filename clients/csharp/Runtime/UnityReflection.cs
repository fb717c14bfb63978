// SPDX-License-Identifier: Apache-2.0
using System;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>
    /// A reflection map as a cube map in Unity's axes. Unity's are left-handed: each face is the mirror image of a face of the
    /// probe, and +Z and −Z change places.
    /// </summary>
    public static class UnityReflection
    {
        /// <summary>Exponents of RGB9E5 are stored with 15 added, and its mantissas have nine bits behind the point.</summary>
        private const int Bias = 15 + 9;

        /// <summary>
        /// Linear radiance of one face: 3 · Size² numbers, red, green, blue; rows from the top, columns from the left, as OpenGL and
        /// Direct3D lay out the faces of a cube map. A check refuses maps of another size before a client sees them.
        /// </summary>
        /// <param name="map">What <see cref="Probe.ReflectionMap"/> gives.</param>
        /// <param name="face">In the order of Unity's CubemapFace: 0 to 5 for +X −X +Y −Y +Z −Z.</param>
        /// <param name="scale">1 for relative light; HDRP: Estimate.CdM2PerUnit.</param>
        public static float[] Face(ReflectionMap map, int face, float scale = 1)
        {
            if (face < 0 || face > 5) throw new ArgumentOutOfRangeException(nameof(face), "expected 0 to 5");
            int size = (int)map.Size, source = face < 4 ? face : 9 - face;
            bool isLevel = face == 2 || face == 3; // ceiling and floor are mirrored from top to bottom, walls from left to right
            var radiance = new float[3 * size * size];
            for (int row = 0; row < size; row++)
                for (int column = 0; column < size; column++)
                {
                    int sourceRow = isLevel ? size - 1 - row : row, sourceColumn = isLevel ? column : size - 1 - column;
                    Decode(map, (source * size + sourceRow) * size + sourceColumn, scale, radiance, 3 * (row * size + column));
                }
            return radiance;
        }

        /// <summary>One texel, little-endian RGB9E5 (OpenGL 4.6, 8.5.2).</summary>
        private static void Decode(ReflectionMap map, int texel, float scale, float[] radiance, int at)
        {
            byte[] data = map.Texels;
            int i = 4 * texel;
            uint bits = data[i] | (uint)data[i + 1] << 8 | (uint)data[i + 2] << 16 | (uint)data[i + 3] << 24;
            double unit = Math.Pow(2, (int)(bits >> 27) - Bias) * map.Scale * scale;
            for (int channel = 0; channel < 3; channel++) radiance[at + channel] = (float)((bits >> 9 * channel & 511) * unit);
        }
    }
}
