// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>Poses and pings as they are sent; ArgumentException for what is none.</summary>
    internal static class Poses
    {
        /// <summary>The square of a unit quaternion's length is off by less.</summary>
        private const double MostNotUnit = 0.02;

        internal static byte[] Pose(IReadOnlyList<float> xyzw, long timeNs, float? sigmaDeg, IReadOnlyList<float> positionM, float? positionSigmaM)
        {
            double square = 0;
            foreach (float value in xyzw) square += (double)value * value;
            if (xyzw.Count != 4 || !(Math.Abs(square - 1) < MostNotUnit))
                throw new ArgumentException("pose: " + Shown(xyzw) + ": expected a unit quaternion x, y, z, w");
            Check("sigmaDeg", sigmaDeg, "degrees");
            Check("positionSigmaM", positionSigmaM, "metres");
            var pose = new Pose { TimeNs = timeNs, SigmaDeg = sigmaDeg };
            pose.Orientation.AddRange(xyzw);
            if (positionM != null)
            {
                bool isFinite = true;
                foreach (float value in positionM) isFinite &= !float.IsNaN(value) && !float.IsInfinity(value);
                if (positionM.Count != 3 || !isFinite)
                    throw new ArgumentException("pose: " + Shown(positionM) + ": expected x, y, z in metres");
                pose.Position.AddRange(positionM);
                pose.PositionSigmaM = positionSigmaM;
            }
            return new FromClient { Pose = pose }.Write(new WireWriter()).ToArray();
        }

        internal static byte[] Ping(long timeNs, long? pongTimeNs) =>
            new FromClient { Ping = new Ping { TimeNs = timeNs, PongTimeNs = pongTimeNs } }.Write(new WireWriter()).ToArray();

        private static void Check(string name, float? sigma, string unit)
        {
            if (sigma.HasValue && !(sigma > 0 && sigma < float.PositiveInfinity))
                throw new ArgumentException("pose: " + name + " " + Shown(new[] { sigma.Value }) + ": expected " + unit + " above 0");
        }

        private static string Shown(IEnumerable<float> values)
        {
            var words = new List<string>();
            foreach (float value in values) words.Add(value.ToString(System.Globalization.CultureInfo.InvariantCulture));
            return string.Join(" ", words);
        }
    }
}
