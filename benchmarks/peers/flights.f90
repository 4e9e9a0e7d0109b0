!  Flights between impacts of the linear oscillator with a vibro-impact sink, for AUTO-07p (IPS = 4).
!
!  Each of the NDIM/4 flights of an orbit's segment is mapped to [0, 1]: U(4 i - 3) ... U(4 i) are u1, u2, u1', u2' of flight i, PAR(20 + i)
!  its time. Start, impacts and end are boundary conditions; the segment begins at the origin. PAR(1) is the energy h, PAR(2)
!  mu, PAR(3) sigma, PAR(4) the end (0: a stop that reverses the motion; 1: the origin; 2: rest), PAR(20 + NDIM/4 + i) the side of the
!  stop, +1 or -1, at the end of flight i. flights.start holds the parameters and the state at the beginning of each flight.

      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      INTEGER I, B
      DOUBLE PRECISION MU, SIGMA, T, RATE(4)

      MU = PAR(2)
      SIGMA = PAR(3)
      IF (IJAC /= 0) DFDU = 0.D0
      DO I = 1, NDIM/4
        B = 4*I - 4
        T = PAR(20+I)
        RATE(1) = U(B+3)
        RATE(2) = U(B+4)
        RATE(3) = -SIGMA*(U(B+1) - U(B+2))/MU
        RATE(4) = -U(B+2) - SIGMA*(U(B+2) - U(B+1))
        F(B+1:B+4) = T*RATE
        IF (IJAC == 0) CYCLE
        DFDU(B+1,B+3) = T
        DFDU(B+2,B+4) = T
        DFDU(B+3,B+1) = -T*SIGMA/MU
        DFDU(B+3,B+2) = T*SIGMA/MU
        DFDU(B+4,B+1) = T*SIGMA
        DFDU(B+4,B+2) = -T*(1.D0 + SIGMA)
        IF (IJAC == 1) CYCLE
        DFDP(1:NDIM,20+I) = 0.D0
        DFDP(B+1:B+4,20+I) = RATE
      ENDDO
      IF (IJAC == 2) DFDP(1:NDIM,1) = 0.D0
      END SUBROUTINE FUNC

      SUBROUTINE BCND(NDIM,PAR,ICP,NBC,U0,U1,FB,IJAC,DBC)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), NBC, IJAC
      DOUBLE PRECISION, INTENT(IN) :: PAR(*), U0(NDIM), U1(NDIM)
      DOUBLE PRECISION, INTENT(OUT) :: FB(NBC)
      DOUBLE PRECISION, INTENT(INOUT) :: DBC(NBC,*)
      INTEGER FLIGHTS, I, A, B, R, E
      DOUBLE PRECISION MU, TOTAL

      FLIGHTS = NDIM/4
      MU = PAR(2)
      TOTAL = 1.D0 + MU
      IF (IJAC /= 0) DBC(1:NBC,1:2*NDIM) = 0.D0
      IF (IJAC == 2) DBC(1:NBC,2*NDIM+1) = 0.D0
      IF (IJAC == 2) DBC(1:NBC,2*NDIM+21:2*NDIM+20+FLIGHTS) = 0.D0
!     The origin, and the energy.
      FB(1) = U0(1)
      FB(2) = U0(2)
      FB(3) = (MU*U0(3)**2 + U0(4)**2)/2.D0 - PAR(1)
      IF (IJAC /= 0) THEN
        DBC(1,1) = 1.D0
        DBC(2,2) = 1.D0
        DBC(3,3) = MU*U0(3)
        DBC(3,4) = U0(4)
        IF (IJAC == 2) DBC(3,2*NDIM+1) = -1.D0
      ENDIF
!     An impact between flights: on its stop, displacements kept, momentum kept, relative velocity reversed.
      DO I = 1, FLIGHTS - 1
        A = 4*I - 4
        B = 4*I
        R = 5*I - 2
        E = NDIM + A
        FB(R+1) = U1(A+1) - U1(A+2) - PAR(20+FLIGHTS+I)
        FB(R+2) = U0(B+1) - U1(A+1)
        FB(R+3) = U0(B+2) - U1(A+2)
        FB(R+4) = U0(B+3) - ((MU - 1.D0)*U1(A+3) + 2.D0*U1(A+4))/TOTAL
        FB(R+5) = U0(B+4) - (2.D0*MU*U1(A+3) + (1.D0 - MU)*U1(A+4))/TOTAL
        IF (IJAC == 0) CYCLE
        DBC(R+1,E+1) = 1.D0
        DBC(R+1,E+2) = -1.D0
        DBC(R+2,B+1) = 1.D0
        DBC(R+2,E+1) = -1.D0
        DBC(R+3,B+2) = 1.D0
        DBC(R+3,E+2) = -1.D0
        DBC(R+4,B+3) = 1.D0
        DBC(R+4,E+3) = -(MU - 1.D0)/TOTAL
        DBC(R+4,E+4) = -2.D0/TOTAL
        DBC(R+5,B+4) = 1.D0
        DBC(R+5,E+3) = -2.D0*MU/TOTAL
        DBC(R+5,E+4) = -(1.D0 - MU)/TOTAL
      ENDDO
!     The end.
      A = NDIM - 4
      E = NDIM + A
      IF (PAR(4) < 0.5D0) THEN
        FB(NBC-1) = U1(A+1) - U1(A+2) - PAR(20+2*FLIGHTS)
        FB(NBC) = MU*U1(A+3) + U1(A+4)
        IF (IJAC /= 0) THEN
          DBC(NBC-1,E+1) = 1.D0
          DBC(NBC-1,E+2) = -1.D0
          DBC(NBC,E+3) = MU
          DBC(NBC,E+4) = 1.D0
        ENDIF
      ELSE
        I = 0
        IF (PAR(4) > 1.5D0) I = 2
        FB(NBC-1) = U1(A+I+1)
        FB(NBC) = U1(A+I+2)
        IF (IJAC /= 0) THEN
          DBC(NBC-1,E+I+1) = 1.D0
          DBC(NBC,E+I+2) = 1.D0
        ENDIF
      ENDIF
      END SUBROUTINE BCND

      SUBROUTINE STPNT(NDIM,U,PAR,T)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: T
      INTEGER FLIGHTS

      FLIGHTS = NDIM/4
      OPEN(UNIT=77, FILE='flights.start', STATUS='old')
      READ(77,*) PAR(1:5)
      READ(77,*) PAR(21:20+FLIGHTS)
      READ(77,*) PAR(21+FLIGHTS:20+2*FLIGHTS)
      READ(77,*) U
      CLOSE(77)
      CALL GUESS(NDIM,U,PAR,T)
      END SUBROUTINE STPNT

      INCLUDE 'common.inc'

!     Where PAR(5) is not 0, every point goes to flights.points.
      SUBROUTINE PVLS(NDIM,U,PAR)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: PAR(*)

      IF (PAR(5) > 0.5D0) CALL APPEND_POINT('flights.points',NDIM,NDIM/4,U,PAR)
      END SUBROUTINE PVLS
