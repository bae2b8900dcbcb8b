"""`pd`: holds the base where it finds it, by proportional and derivative control, in place of `base`."""

import math

from fss.service import Refused, Service, main

import fss_messages
from pd_messages import PdState

# Navigation that is older counts as none, ns.
OLDEST_NS = 50_000_000
# Of the default vehicle in the posture of `hold`: kg, kg m2 about the centre of mass, and where that is in base axes, m.
MASS_KG, INERTIA_KG_M2, COM_M = 21.52, 6.0687, (0.4608, 0.0712)
THRUST_N, LEVER_M = 0.159, 0.065
# Direction of each thruster's push in base axes, and which way it turns the base.
PUSHES = [(-1, 0, 1), (-1, 0, -1), (1, 0, -1), (1, 0, 1), (0, -1, -1), (0, -1, 1), (0, 1, 1), (0, 1, -1)]


class Pd(Service):
    name = "pd"
    inputs = {"nav": fss_messages.NAV_STATE, "mission": fss_messages.MISSION_STATE}
    outputs = {"state": ("/pd/state", PdState), "thrusters": fss_messages.THRUSTERS_COMMAND}
    config = ("bandwidth_rad_s",)

    def __init__(self, config, rate_hz):
        self.bandwidth = config["bandwidth_rad_s"]
        if self.bandwidth <= 0.0:
            raise Refused("config: bandwidth_rad_s is more than zero")
        self.goal = None
        self.owed = [0.0] * len(PUSHES)

    def step(self, now_ns, inputs, outputs):
        nav, mission = inputs.nav.within(now_ns, OLDEST_NS), inputs.mission.get()
        flies = nav is not None and mission is not None and mission.state == fss_messages.MissionState.RUNNING
        command = fss_messages.ThrustersCommand(stamp_ns=now_ns, valve_count=len(PUSHES))
        if flies:
            for thruster, duty in enumerate(self.duty_cycles(nav)):
                # A valve opens for a step when a step's impulse is owed.
                self.owed[thruster] += min(duty, 1.0)
                if self.owed[thruster] >= 1.0:
                    command.valves[thruster], self.owed[thruster] = 1, self.owed[thruster] - 1.0
        outputs.thrusters.publish(command)
        speed = math.hypot(nav.vx_m_s, nav.vy_m_s) if flies else 0.0
        outputs.state.publish(PdState(stamp_ns=now_ns, speed_m_s=speed, valid=int(flies)))

    def duty_cycles(self, nav):
        pose, rate = (nav.x_m, nav.y_m, nav.theta_rad), (nav.vx_m_s, nav.vy_m_s, nav.omega_rad_s)
        self.goal = self.goal or pose
        w = self.bandwidth
        ax, ay, turn = (-w * w * (p - g) - 1.4 * w * v for p, g, v in zip(pose, self.goal, rate))
        sin, cos = math.sin(nav.theta_rad), math.cos(nav.theta_rad)
        ax, ay = cos * ax + sin * ay, cos * ay - sin * ax
        fx, fy = MASS_KG * (ax - turn * COM_M[1]), MASS_KG * (ay + turn * COM_M[0])
        torque = INERTIA_KG_M2 * turn + COM_M[0] * fy - COM_M[1] * fx
        for x, y, way in PUSHES:
            push = max(0.0, x * fx) + max(0.0, y * fy)
            yield push / (2 * THRUST_N) + max(0.0, way * torque) / (4 * LEVER_M * THRUST_N)


if __name__ == "__main__":
    main(Pd)
