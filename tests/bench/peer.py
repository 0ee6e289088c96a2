# SPDX-License-Identifier: Apache-2.0
"""VTK's CPU ray caster on the scenes of the bench."""
import glob
import os


def chosen(cameras, count):
    count = min(count, len(cameras))
    return [cameras[i * len(cameras) // count] for i in range(count)]


def find(folder, name):
    hits = glob.glob(os.path.join(folder, '**', name), recursive=True)
    return hits[0] if hits else None


def demos(scenes):
    return [name for name, scene in scenes.items() if scene['volume'].startswith('demo:')]


class Peer:
    """Runs VTK on copies of the scenes of the part "scenes", with built-in volumes saved as files."""

    def __init__(self, run):
        self.run, self.script, self.scenes = run, run.o.vtk_bench, run.scenes_of('scenes')
        self.data = os.path.join(run.work, 'volumes')
        if not self.script:
            return
        os.mkdir(self.data)
        for name in demos(self.scenes):
            run.bench(f'saving the volume of {name} for VTK', '--save-volume', self.data + '/', '--views', 1, '--warm', 0,
                      '--size', 16, *run.files(1, [name]))
        for scene in self.scenes.values():
            found = find(run.o.data, scene['volume'])
            if found and not os.path.exists(os.path.join(self.data, scene['volume'])):
                os.symlink(found, os.path.join(self.data, scene['volume']))

    def measure(self, size, threads, shading, views):
        def change(scene):
            scene['cameras'] = chosen(scene['cameras'], views)
            if scene['volume'].startswith('demo:'):
                scene['volume'] = scene['name'] + '.nrrd'
        files = [self.run.scene_copy(name, change) for name in self.scenes]
        command = ['xvfb-run', '-a', '-s', '-screen 0 1280x1280x24', '/usr/bin/python3', self.script, '--data', self.data,
                   '--size', str(size), '--threads', str(threads), '--views', str(views), '--warm', '1']
        if shading == 'phong':
            command.append('--shade')
        return self.run.call(f'VTK, {describe(size, threads, shading)}, {views} views', command + files)


def describe(size, threads, shading):
    return f'{size} px, {threads} thread{"s" if threads > 1 else ""}, {"shaded" if shading == "phong" else "not shaded"}'
