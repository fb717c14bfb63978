// Drives a camera at HOST PORT with the npm package osc-client and prints what it understood.
'use strict'

const OscClient = require('osc-client').Osc2Client
const client = new OscClient(process.argv[2], process.argv[3])
const tried = (promise) => promise.then((answer) => answer, (error) => ({ code: error.oscCode }))

async function main () {
  const report = {}
  report.info = await tried(client.getInfo())
  report.state = await tried(client.getState())
  report.set = await tried(client.setOptions(undefined, { exposureProgram: 1, shutterSpeed: 0.004 }))
  report.options = await tried(client.getOptions(undefined, ['shutterSpeed', 'isoSupport']))
  report.wrongValue = await tried(client.setOptions(undefined, { shutterSpeed: 0.0041 }))
  report.wrongName = await tried(client.getOptions(undefined, ['noSuchOption']))
  report.wrongCommand = await tried(client.startCapture())
  report.picture = await tried(client.takePicture(undefined, () => {}))
  report.reset = await tried(client.reset())
  console.log(JSON.stringify(report))
}

main().catch((error) => { console.error(error); process.exit(1) })
