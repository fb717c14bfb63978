// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>The room as a box: what it makes of the ambient light beside the probe (docs/users/conventions.md, "Ambient light at a place").</summary>
    internal static class AmbientBox
    {
        /// <summary>Directions in which the light is looked up.</summary>
        private const int Directions = 128;
        /// <summary>A place beyond a wall, or closer to it, is taken to be at this share of the way to it.</summary>
        private const double Within = 0.95;
        private const int MaxOrder = 4;

        private static readonly double[] Sphere = Fibonacci();
        /// <summary>Scale of Y_lm, at l * (MaxOrder + 1) + m.</summary>
        private static readonly double[] Norms = AllNorms();
        private static readonly Table[] Tables = new Table[MaxOrder + 1];

        /// <summary>Of an order: Y_i of the directions times 4π/n, and which SH the light in these directions has, by the SH of the light.</summary>
        private sealed class Table
        {
            internal readonly double[] Basis, Seen;

            internal Table(int order)
            {
                int count = (order + 1) * (order + 1);
                double weight = 4 * Math.PI / Directions;
                var one = new double[count];
                Basis = new double[count * Directions];
                Seen = new double[count * count];
                for (int k = 0; k < Directions; k++)
                {
                    FillBasis(order, Sphere[3 * k], Sphere[3 * k + 1], Sphere[3 * k + 2], one);
                    for (int i = 0; i < count; i++)
                    {
                        Basis[k * count + i] = weight * one[i];
                        for (int j = 0; j < count; j++) Seen[i * count + j] += weight * one[i] * one[j];
                    }
                }
            }
        }

        /// <summary>What the SH of a room's ambient light are at a place: metres from the probe, axes of the estimate's frame.</summary>
        internal static void Move(IList<float> coefficients, Room room, double x, double y, double z, List<float> there)
        {
            int order = (int)Math.Round(Math.Sqrt(coefficients.Count / 3)) - 1, count = (order + 1) * (order + 1);
            Table table = Tables[order] ?? (Tables[order] = new Table(order));
            double[] turn = Turn(room.Orientation), from = new double[3 * count], sum = new double[3 * count], one = new double[count];
            for (int i = 0; i < from.Length; i++) from[i] = coefficients[i];
            double lowX = -room.WallsM[0], highX = room.WallsM[1], lowY = -room.WallsM[2], highY = room.WallsM[3], lowZ = -room.WallsM[4], highZ = room.WallsM[5];
            double px = Inside(turn[0] * x + turn[3] * y + turn[6] * z, lowX, highX);
            double py = Inside(turn[1] * x + turn[4] * y + turn[7] * z, lowY, highY);
            double pz = Inside(turn[2] * x + turn[5] * y + turn[8] * z, lowZ, highZ);
            for (int k = 0; k < Directions; k++)
            {
                double dx = Sphere[3 * k], dy = Sphere[3 * k + 1], dz = Sphere[3 * k + 2];
                double bx = turn[0] * dx + turn[3] * dy + turn[6] * dz, by = turn[1] * dx + turn[4] * dy + turn[7] * dz, bz = turn[2] * dx + turn[5] * dy + turn[8] * dz;
                double t = Math.Min(WayM(bx, px, lowX, highX), Math.Min(WayM(by, py, lowY, highY), WayM(bz, pz, lowZ, highZ)));
                double hx = px + t * bx, hy = py + t * by, hz = pz + t * bz, share = 1 / Math.Sqrt(hx * hx + hy * hy + hz * hz);
                hx *= share;
                hy *= share;
                hz *= share;
                FillBasis(order, turn[0] * hx + turn[1] * hy + turn[2] * hz, turn[3] * hx + turn[4] * hy + turn[5] * hz, turn[6] * hx + turn[7] * hy + turn[8] * hz, one);
                double r = 0, g = 0, b = 0;
                for (int j = 0, c = 0; j < one.Length; j++, c += 3)
                {
                    double w = one[j];
                    r += w * from[c];
                    g += w * from[c + 1];
                    b += w * from[c + 2];
                }
                for (int i = 0, c = 0, at = k * count; i < count; i++, c += 3, at++)
                {
                    double w = table.Basis[at];
                    sum[c] += w * r;
                    sum[c + 1] += w * g;
                    sum[c + 2] += w * b;
                }
            }
            for (int i = 0; i < count; i++)
                for (int j = 0; j < count; j++)
                    for (int c = 0; c < 3; c++) sum[3 * i + c] -= table.Seen[i * count + j] * from[3 * j + c];
            for (int i = 0; i < from.Length; i++) there.Add((float)(from[i] + sum[i]));
        }

        /// <summary>A coordinate of the place in the box's axes, within the walls.</summary>
        private static double Inside(double value, double low, double high) => Math.Max(Within * low, Math.Min(Within * high, value));

        /// <summary>How far it is along a ray from a place to the walls across one axis.</summary>
        private static double WayM(double ray, double place, double low, double high) =>
            ray == 0 ? double.PositiveInfinity : ((ray > 0 ? high : low) - place) / ray;

        /// <summary>Row by row: turns the box's axes into the estimate's frame.</summary>
        private static double[] Turn(IList<float> xyzw)
        {
            double x = xyzw[0], y = xyzw[1], z = xyzw[2], w = xyzw[3], s = 2 / (x * x + y * y + z * z + w * w);
            return new[]
            {
                1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y), s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x),
                s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y),
            };
        }

        /// <summary>Y_i of a unit vector (Sloan, JCGT 2013).</summary>
        private static void FillBasis(int order, double x, double y, double z, double[] values)
        {
            double cosine = 1, sine = 0, diagonal = 1;
            for (int m = 0; m <= order; m++)
            {
                double before = 0, here = diagonal;
                for (int l = m; l <= order; l++)
                {
                    double scale = Norms[l * (MaxOrder + 1) + m] * here;
                    int centre = l * (l + 1);
                    values[centre + m] = scale * cosine;
                    if (m > 0) values[centre - m] = scale * sine;
                    double next = ((2 * l + 1) * z * here - (l + m) * before) / (l - m + 1);
                    before = here;
                    here = next;
                }
                double turned = x * cosine - y * sine;
                sine = x * sine + y * cosine;
                cosine = turned;
                diagonal *= 2 * m + 1;
            }
        }

        private static double[] AllNorms()
        {
            var norms = new double[(MaxOrder + 1) * (MaxOrder + 1)];
            for (int l = 0; l <= MaxOrder; l++)
                for (int m = 0; m <= l; m++)
                {
                    double ratio = 1;
                    for (int k = l - m + 1; k <= l + m; k++) ratio /= k;
                    norms[l * (MaxOrder + 1) + m] = Math.Sqrt((2 * l + 1) / (4 * Math.PI) * ratio * (m > 0 ? 2 : 1));
                }
            return norms;
        }

        /// <summary>x, y, z of directions that are spread evenly.</summary>
        private static double[] Fibonacci()
        {
            var sphere = new double[3 * Directions];
            for (int k = 0; k < Directions; k++)
            {
                double y = 1 - 2 * (k + 0.5) / Directions, ring = Math.Sqrt(1 - y * y), phi = Math.PI * (1 + Math.Sqrt(5)) * (k + 0.5);
                sphere[3 * k] = ring * Math.Cos(phi);
                sphere[3 * k + 1] = y;
                sphere[3 * k + 2] = ring * Math.Sin(phi);
            }
            return sphere;
        }
    }
}
