# SPDX-License-Identifier: Apache-2.0
"""Measures the GPU backend; run_all.py calls it."""
import json
import os
import subprocess
import sys

from pairs import flat, pair, PAIR_COLUMNS

GL_COLUMNS = ['scene', 'backend', 'device', 'size', 'shading', 'views', 'visible_voxels', 'splats', 'fragments', 'median_ms', 'p95_ms',
              'mean_ms', 'fps', 'in_flight_2_fps', 'splats_per_second', 'classify_ms', 'splat_ms', 'bin_ms', 'tile_ms', 'resolve_ms', 'read_ms',
              'rest_ms', 'cpu_fps', 'derived_bytes', 'peak_gb_s', 'peak_tflop_s', 'left_out']
GL_PIXEL_COLUMNS = ['scene', 'backend', 'device', 'size', 'shading', 'views', 'median_ms', 'p95_ms', 'mean_ms', 'fps']
GL_PEER_COLUMNS = ['scene', 'renderer', 'size', 'shading', 'views', 'median_ms', 'mean_ms', 'fps']
GL_EDIT_COLUMNS = ['backend'] + PAIR_COLUMNS + ['left_out']


class Gpu:
    """Measures the GPU backend: in full on hardware; on software GL, whose times mean nothing, only two views, which show
    that a scene renders. Scenes that take more than `limit` seconds are omitted."""

    def __init__(self, run, elements):
        """elements: number of runs of the part "elements"."""
        self.backend, self.device, self.why = '', '', []
        for backend in ('gl', 'gl-software'):
            done = subprocess.run([os.path.join(run.o.bin, 'splat-bench'), '--backend', backend, '--views', '1', '--warm', '0', '--size', '8',
                                   '--volume', 'demo:sparse?size=8'], capture_output=True, text=True, check=False)
            if done.returncode == 0:
                self.backend, self.device = backend, json.loads(done.stdout)['device']
                break
            self.why += done.stderr.strip().splitlines()[-1:] or [f'{backend}: exit status {done.returncode}']
        hardware = self.backend == 'gl'
        if hardware:  # a GPU raises its clock after seconds of work
            run.program('warming the GPU', [os.path.join(run.o.bin, 'splat-bench'), '--backend', 'gl', '--warm', '1000', '--views', '1', '--size', '1024',
                                            '--volume', 'demo:engine'])
        self.corners = [(size, shading) for shading in (('none', 'phong') if hardware else ('none',)) for size in (512, 1024, 2048)]
        if run.o.quick:
            self.corners = self.corners[:1]
        self.views, self.warm, self.limit = (run.o.views, 20, 600) if hardware else (2, 0, run.o.software_limit)
        self.edited = list(run.scenes) if hardware else [name for name in run.scenes if name == 'lobster'] or list(run.scenes)[:1]
        steps = len(self.corners) * (1 + 2 * len(run.scenes) + 2 * hardware) + 3 * len(self.edited) + elements + 2 * hardware
        self.steps = steps if self.backend else 0

    def description(self):
        return self.device or 'not measured: ' + '; '.join(self.why)


def gl_rows(run, name, shading, label, common, cpu_fps, slow):
    """Returns the row of a scene with one and with two frames in flight, or [] if it failed. slow: (scene, shading) → why it
    was omitted at a smaller size, and so is at larger ones."""
    gpu, known = run.gpu, (name, shading)
    own = {'scene': name, 'backend': gpu.backend, 'device': gpu.device, 'size': common[1], 'shading': shading, 'views': gpu.views}
    if known in slow:
        run.skip(2, f'{name}, {gpu.backend}, {label}; {slow[known]}')
        return [flat(own, left_out=slow[known])]
    one, = run.files(gpu.views, [name])
    drawn = run.bench(f'{name}, {gpu.backend}, {label}', *common, one, backend=gpu.backend, limit=gpu.limit)
    if drawn is None:
        slow[known] = f'more than {gpu.limit} s at {common[1]} px'
    if not drawn:
        run.done += 1
        return [] if drawn == [] else [flat(own, left_out=slow[known])]
    both = run.bench(f'{name}, {gpu.backend}, {label}, two in flight', *common, '--in-flight', 2, one, backend=gpu.backend, limit=gpu.limit)
    return [flat(drawn[0], cpu_fps=cpu_fps, in_flight_2_fps=both[0]['fps'] if both else '', peak_gb_s=run.o.gpu_peak[0],
                 peak_tflop_s=run.o.gpu_peak[1], **{stage + '_ms': ms for stage, ms in drawn[0]['stages'].items()})]


def measure_gl_pixels(run):
    """The same for sheets that are classified per pixel, with two frames in flight, as the daemon draws them."""
    gpu, rows = run.gpu, []
    for size, shading in gpu.corners:
        label = f'per pixel, {gpu.backend}, {size} px, {"shaded" if shading == "phong" else "not shaded"}, two in flight'
        for row in run.bench(label, '--size', size, '--shading', shading, '--warm', gpu.warm, '--in-flight', 2, *run.files(gpu.views), backend=gpu.backend,
                             order='auto') or []:
            rows.append(flat(row))
        run.write('gl_pixels.csv', GL_PIXEL_COLUMNS, rows)


def measure_gl_peer(run):
    """VTK's GPU ray caster on the same GPU, if the Python that runs this has a VTK that needs no display (9.4 or newer)."""
    gpu, rows = run.gpu, []
    modern = subprocess.run([sys.executable, '-c', 'import vtk; v = vtk.vtkVersion; assert (v.GetVTKMajorVersion(), v.GetVTKMinorVersion()) >= (9, 4)'],
                            capture_output=True, check=False).returncode == 0
    if not run.o.vtk_bench or not modern:
        run.skip(len(gpu.corners), "VTK on the GPU; this Python has no VTK 9.4 or newer, or --vtk-bench was not given")
        return
    for size, shading in gpu.corners:
        command = [sys.executable, run.o.vtk_bench, '--mapper', 'gpu', '--data', run.o.data, '--size', str(size), '--views', str(gpu.views), '--warm', str(gpu.warm)]
        real = [name for name, scene in run.scenes.items() if not scene['volume'].startswith('demo:')]
        for row in run.call(f'VTK on the GPU, {size} px, {shading}', command + ['--shade'] * (shading == 'phong') + run.files(gpu.views, real)) or []:
            rows.append({**row, 'shading': shading})
        run.write('gl_vtk.csv', GL_PEER_COLUMNS, rows)


def measure_gl_edits(run):
    """Compares a transfer function that changes at every frame with a fixed one, at 512 px."""
    gpu, rows = run.gpu, []
    for edit in ('colour', 'opacity', 'range'):
        for name in gpu.edited:
            found = run.bench(f'{name}, {gpu.backend}, transfer function changing ({edit}) against fixed', '--size', 512, '--warm', 1, '--edit', edit,
                              '--against', 'edit=none', *run.files(gpu.views, [name]), backend=gpu.backend, limit=gpu.limit)
            if found is None:
                rows.append({'scene': name, 'backend': gpu.backend, 'setting': 'edit=' + edit, 'left_out': f'more than {gpu.limit} s'})
            rows += [pair(row, 'edit=' + edit) for row in found or []]
    run.write('gl_edits.csv', GL_EDIT_COLUMNS, rows)
