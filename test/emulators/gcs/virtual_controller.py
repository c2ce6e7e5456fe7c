# Copyright 2026 piezo_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
A virtual controller that speaks GCS 2.0, with the simulated rig behind its axis 1.

A wave runs to its end when it is started, without time passing. README.md beside this file lists
what is assumed of a real controller.
"""

import contextlib
import dataclasses
import socketserver
import threading

import numpy as np

from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

CYCLE_S = 5e-5
RECORDER_POINTS = 262_144
RECORDER_TABLES = 8
WAVE_POINTS = 262_144
VOLTS_PER_UM = 8.0  # of the output amplifier
ROWS_AFTER_A_WAVE = 200  # that the recorder keeps; a real one goes on until its tables are full


@dataclasses.dataclass
class Faults:
    """What the controller does wrong."""

    lost_points: int = 0  # of the end of each wave, that do not go out
    delay_cycles: int = 3  # from the start of the generator to its first point
    silent: bool = False  # it answers nothing
    stuck_um: float | None = None


class GcsError(Exception):
    def __init__(self, code):
        super().__init__(code)
        self.code = code


class VirtualController:
    """
    One axis, open loop; targets are micrometres.

    Attributes
    ----------
    targets_um : list of ndarray
        What the target went to, for each servo cycle of a wave or each command.
    rows : ndarray, shape (N, 2)
        What the recorder has: position, voltage.

    """

    def __init__(self, parameters=None, *, target_scale_um_per_v=1.2, held_um=None):
        self.parameters = parameters or RigParameters()
        self._scale = target_scale_um_per_v
        self._rig = Rig(self.parameters, CYCLE_S, compiled=False)
        self.target_um = self.parameters.operating_point_um if held_um is None else held_um
        if held_um is not None:
            self._rig.drive(np.full(1000, self._deviation_v(held_um)))
        self.targets_um = [np.array([self.target_um])]
        self.faults = Faults()
        self.servo_on = False
        self.error = 0
        self.rows = np.empty((0, 2))
        self.waves = {}
        self.selected, self.rates, self.record_rate = {}, {1: 1}, 1
        self.recorded = {}

    def _deviation_v(self, target_um):
        return (target_um - self.parameters.operating_point_um) / self._scale

    def position_um(self):
        if self.faults.stuck_um is not None:
            return self.faults.stuck_um
        return self._rig.measure() + self.parameters.operating_point_um

    def answer(self, line):
        """Return the reply to a line, '' for none."""
        name, *words = line.split()
        question = name.endswith('?')
        method = getattr(self, ('ask_' if question else 'do_') + name.strip('*?').lower(), None)
        try:
            if method is None:
                raise GcsError(2)
            reply = method(*words)
        except GcsError as error:
            self.error = error.code
            return ''
        except (TypeError, ValueError):
            self.error = 1
            return ''
        return reply if question else ''

    def answer_byte(self, byte):
        """Return the reply to a command of one byte."""
        if byte == 24:
            self.error = 10
            return ''
        return {5: '0\n', 7: '\xb1\n', 9: '0\n'}[byte]

    # Questions

    def ask_err(self):
        code, self.error = self.error, 0
        return f'{code}\n'

    def ask_idn(self):
        return '(c)2026 Emulator, E-727.1CD, 0116021234, 1.2.3.4\n'

    def ask_sai(self):
        return '1 \n2 \n3\n'

    def ask_tnr(self):
        return f'{RECORDER_TABLES}\n'

    def ask_spa(self, item, parameter):
        value = {
            '0x0E000200': CYCLE_S, '0x16000200': RECORDER_POINTS, '0x13000004': WAVE_POINTS,
        }.get(parameter)
        if value is None:
            raise GcsError(54)
        return f'{item} {parameter}={value:.9g}\n'

    def ask_svo(self, axis):
        return f'{self._axis(axis)}={int(self.servo_on)}\n'

    def ask_sva(self, axis):
        return f'{self._axis(axis)}={self.target_um:.9f}\n'

    def ask_pos(self, axis):
        return f'{self._axis(axis)}={self.position_um():.9f}\n'

    def ask_drl(self, table):
        return f'{table}={len(self.rows)}\n'

    def ask_drr(self, first, count, *tables):
        columns = [self.recorded[int(table)] for table in tables]
        first, count = int(first) - 1, int(count)
        rows = self.rows[first:first + count]
        head = [
            '# REM E-727', '# VERSION = 1', '# TYPE = 1', '# SEPARATOR = 32',
            f'# DIM = {len(tables)}', f'# SAMPLE_TIME = {self.record_rate * CYCLE_S:.9f}',
            f'# NDATA = {len(rows)}']
        head += [f'# NAME{index} = table {table}' for index, table in enumerate(tables)]
        values = [' '.join(f'{row[column]:.6f}' for column in columns) for row in rows.tolist()]
        return ' \n'.join([*head, '# END_HEADER', *values]) + '\n'

    # Commands

    def do_sva(self, axis, target):
        self._axis(axis)
        self._open_loop()
        self.target_um = float(target)
        self.targets_um.append(np.array([self.target_um]))
        # Software takes its time: a cycle.
        self._rig.answer(self._rig.index, np.array([self._deviation_v(self.target_um)]))

    def do_svo(self, axis, on):
        self._axis(axis)
        self.servo_on = bool(int(on))

    def do_wav(self, table, append, kind, start, count, *points):
        if kind != 'PNT' or start != '1' or int(count) != len(points) or append not in 'X&':
            raise GcsError(17)
        before = self.waves.get(table, []) if append == '&' else []
        wave = [*before, *map(float, points)]
        if len(wave) > WAVE_POINTS or not np.isfinite(wave).all():
            raise GcsError(17)
        self.waves[table] = wave

    def do_wsl(self, generator, table):
        if table not in self.waves:
            raise GcsError(17)
        self.selected[self._generator(generator)] = table

    def do_wgc(self, generator, cycles):
        if self._generator(generator) and int(cycles) != 1:
            raise GcsError(17)

    def do_wtr(self, generator, rate, interpolation):
        # As users report of the E-727: for all generators at once only.
        if int(generator) != 0 or int(rate) < 1 or interpolation not in ('0', '1'):
            raise GcsError(17)
        self.rates[1] = int(rate)

    def do_rtr(self, rate):
        if int(rate) < 1:
            raise GcsError(17)
        self.record_rate = int(rate)

    def do_drc(self, *words):
        for table, _, option in zip(*[iter(words)] * 3, strict=True):
            if option not in ('2', '7') or not 1 <= int(table) <= RECORDER_TABLES:
                raise GcsError(17)
            self.recorded[int(table)] = {'2': 0, '7': 1}[option]

    def do_wgo(self, generator, mode):
        generator = self._generator(generator)
        if mode == '0':
            return
        self._open_loop()
        if generator not in self.selected:
            raise GcsError(17)
        points = np.array(self.waves[self.selected[generator]])
        points = points[:points.size - self.faults.lost_points]
        rate = self.rates[1]
        rest = ROWS_AFTER_A_WAVE * max(rate, self.record_rate)
        targets_um = np.concatenate([
            np.full(self.faults.delay_cycles * rate, self.target_um), np.repeat(points, rate),
            np.full(rest, points[-1])])
        # In each cycle the position is taken, then the output is set.
        first_um = self.position_um()
        positions_um = self._rig.answer(self._rig.index, self._deviation_v(targets_um)) + (
            self.parameters.operating_point_um)
        positions_um = np.concatenate([[first_um], positions_um[:-1]])
        if self.faults.stuck_um is not None:
            positions_um[:] = self.faults.stuck_um
        rows = np.column_stack([positions_um, VOLTS_PER_UM * targets_um - 20.0])
        self.rows = rows[::self.record_rate][:RECORDER_POINTS // RECORDER_TABLES]
        self.target_um = float(points[-1])
        self.targets_um.append(targets_um)

    def _axis(self, axis):
        if axis != '1':
            raise GcsError(15)
        return axis

    def _generator(self, generator):
        if generator != '1':
            raise GcsError(17)
        return generator

    def _open_loop(self):
        if self.servo_on:
            raise GcsError(5)


@contextlib.contextmanager
def served(controller):
    """Serve a controller on loopback; yields its address."""
    class Handler(socketserver.StreamRequestHandler):
        def handle(self):
            with contextlib.suppress(OSError):  # the client has gone
                self.answer_all()

        def answer_all(self):
            line = b''
            while byte := self.rfile.read(1):
                if byte[0] in (5, 7, 9, 24):
                    reply = controller.answer_byte(byte[0])
                elif byte == b'\n':
                    reply, line = controller.answer(line.decode('ascii')), b''
                else:
                    line += byte
                    continue
                if reply and not controller.faults.silent:
                    self.wfile.write(reply.encode('latin-1'))

    class Server(socketserver.ThreadingTCPServer):
        daemon_threads = True
        allow_reuse_address = True
        connections = ()

        def process_request(self, request, client_address):
            self.connections = (*self.connections, request)
            super().process_request(request, client_address)

    with Server(('127.0.0.1', 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={'poll_interval': 0.01})
        thread.start()
        try:
            yield server, f'127.0.0.1:{server.server_address[1]}'
        finally:
            server.shutdown()
            thread.join()
