// SPDX-License-Identifier: Apache-2.0
// Prints the strongest lamp, ten times a second. Without Unity:
//   mcs -langversion:7.2 -out:watch.exe Runtime/*.cs Examples~/Watch.cs && mono watch.exe tcp:127.0.0.1:7700
using System;
using Lightprobe;
using Lightprobe.Messages;

static class Watch
{
    static void Main(string[] arguments)
    {
        using (var probe = new Probe(arguments[0], new Subscription { RateHz = 10, HealthPeriodMs = 1000 }))
            for (; ; )
            {
                Estimate light = probe.WaitForNext(2000);
                if (light == null) Console.WriteLine(probe.LastError ?? "no light yet");
                else if (light.Lights.Count == 0) Console.WriteLine("no lamp");
                else Console.WriteLine("lamp towards " + string.Join(" ", light.Lights[0].Direction) + ", irradiance " + string.Join(" ", light.Lights[0].Irradiance));
            }
    }
}
